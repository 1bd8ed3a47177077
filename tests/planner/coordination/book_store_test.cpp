// Books of keepers on disk: what comes back is what was saved, and what is damaged or missing is never begun anew.
#include "planner_daemon/coordination/book_store.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <stdexcept>
#include <tuple>

#include "lcmtypes/bus/packed_cell_messages.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "planner_daemon/trajectory/motion.h"
#include "tests/support/harness.h"
#include "tests/support/quintic_to.h"

namespace swarm::test {
namespace {

constexpr Cell kHere{3, -2};

// By what three robots said: one is a member with a plan, one was expelled, one has left.
CellKeeper::Book some_book() {
  CellKeeper keeper({kHere});
  const auto keep = [](const CellKeeper::Book&) { return true; };
  const auto say = [&](int id, std::int64_t seq, bool wishes, bool plans) {
    CellAnnouncement message{};
    message.robot.header = make_header(id, 5, seq, kStart);
    message.robot.radius = 0.2f;
    const Trajectory hover = Trajectory::hover(7, kStart, {25.0 + id, -12, 1});
    message.robot.committed = hover.to_wire();
    message.robot.least_delay_us = sogm_swarm::announcement_t::kUnknown;
    if (plans) {
      message.robot.pending = quintic_to(hover.at(kStart), kStart + 100ms, {26.0 + id, -12, 1}, 2.0, 5, 8).to_wire();
      message.robot.pending_state = sogm_swarm::announcement_t::kAnnounced;
      message.robot.pending_stamp = to_us(kStart);
    }
    message.cells[kHere] = {(std::int64_t{5} << 32) + 1, wishes};
    const auto packed = pack(&message);  // as it crosses the air
    CellAnnouncement heard;
    ASSERT_TRUE(packed);
    ASSERT_EQ(unpack(*packed, &heard), Refusal::kNone);
    keeper.receive(heard, keep);
  };
  say(1, 1, true, true), say(2, 1, true, true), say(9, 1, true, false);
  EXPECT_TRUE(keeper.expel(2, keep));
  say(9, 2, false, false);
  return keeper.book();
}

std::string complaint(const std::function<void()>& act) {
  try {
    act();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

void write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

TEST(BookStore, WhatIsReadIsWhatWasWritten) {
  const CellKeeper::Book book = some_book();
  ASSERT_EQ(book.records.size(), 3u);
  const CellKeeper::Book read = read_book(text_of_book(book));
  EXPECT_EQ(read.cell, kHere);
  EXPECT_EQ(read.seq, book.seq);
  EXPECT_EQ(read.epoch, book.epoch);
  for (const auto& [id, record] : book.records) {
    const CellKeeper::Record& other = read.records.at(id);
    EXPECT_EQ(other.state, record.state);
    EXPECT_EQ(other.wish, record.wish);
    EXPECT_EQ(other.since, record.since);
    const auto told = [](const sogm_swarm::header_t& h) { return std::tuple(h.robot_id, h.boot, h.seq, h.utime); };
    EXPECT_EQ(told(other.robot.header), told(record.robot.header));
    EXPECT_TRUE(motion_of(other.robot).committed.seq() == motion_of(record.robot).committed.seq());
  }
  CellRoster said = CellKeeper::roster_of(book), says = CellKeeper::roster_of(read);
  const sogm_swarm::header_t header = make_header(0, 1, 1, kStart);
  EXPECT_EQ(pack(header, &says)->packed, pack(header, &said)->packed) << "the same roster";
}

TEST(BookStore, NothingDamagedIsRead) {
  const std::string text = text_of_book(some_book());
  for (std::size_t i = 0; i < text.size(); ++i) {
    std::string damaged = text;
    damaged[i] = static_cast<char>(damaged[i] ^ 1);
    EXPECT_THROW((void)read_book(damaged), std::runtime_error) << i;
    EXPECT_THROW((void)read_book(text.substr(0, i)), std::runtime_error) << i;
  }
  EXPECT_THROW((void)read_book(text + text), std::runtime_error);
}

TEST(BookStore, GoesOnWithWhatWasSaved) {
  const TemporaryDirectory directory;
  const std::filesystem::path books = directory / "books";
  FileBookStore::begin(books, 8);
  CellKeeper::Book book = some_book();
  {
    FileBookStore store(books, 8);
    EXPECT_TRUE(store.load().empty());
    ASSERT_TRUE(store.save(book));
    ++book.seq;
    ASSERT_TRUE(store.save(book));
    ASSERT_TRUE(store.save({{0, 0}}));
    EXPECT_NE(complaint([&] { FileBookStore second(books, 8); }).find("another keeper_daemon has its books here"),
              std::string::npos);
  }
  FileBookStore::begin(books, 8);  // there are some: nothing is lost
  FileBookStore store(books, 8);
  const auto loaded = store.load();
  ASSERT_EQ(loaded.size(), 2u);
  EXPECT_EQ(loaded[0].cell, (Cell{0, 0}));
  EXPECT_EQ(loaded[1].cell, kHere);
  EXPECT_EQ(text_of_book(loaded[1]), text_of_book(book));
}

TEST(BookStore, WhatIsLostOrDamagedIsNotBegunAnew) {
  const TemporaryDirectory directory;
  const std::filesystem::path& books = directory.path();
  EXPECT_EQ(complaint([&] { FileBookStore store(books, 8); }),
            books.string() + ": has no books; --new true begins them, only while no robot flies");
  FileBookStore::begin(books, 8);
  EXPECT_EQ(complaint([&] { FileBookStore store(books, 9); }),
            (books / "cells").string() + ": says 'edge of the cells [m]: 8', not 9");
  FileBookStore store(books, 8);
  ASSERT_TRUE(store.save(some_book()));
  const std::filesystem::path file = books / "cell_3_-2.book";
  std::ifstream in(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  EXPECT_EQ(text, text_of_book(some_book()));
  write(file, text.substr(0, text.size() / 2));
  EXPECT_EQ(complaint([&] { (void)store.load(); }), file.string() + ": is no whole book of a cell: its checksum");
  std::filesystem::remove(file);
  std::filesystem::create_directory(file);
  EXPECT_FALSE(store.save(some_book())) << "there is no place for it";
}

}  // namespace
}  // namespace swarm::test
