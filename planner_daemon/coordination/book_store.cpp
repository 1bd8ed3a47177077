#include "planner_daemon/coordination/book_store.h"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <optional>
#include <span>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/crc32.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr char kTitle[] = "sogm_swarm book of a cell";
constexpr char kGround[] = "cells", kBook[] = ".book";
constexpr int kMaxId = 32767;
constexpr const char* kStates[] = {"member", "expelled", "left"};  // in the order of Membership

std::filesystem::path lock_in(const std::filesystem::path& directory) {
  return directory / "keeper.lock";
}
constexpr char kOther[] = "another keeper_daemon has its books here";

std::string ground_text(double cell_m) {
  return "edge of the cells [m]: " + text_of(cell_m) + "\n";
}

std::string read_text(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  if (!in) throw std::runtime_error(path.string() + ": cannot be read");
  return text;
}

std::int64_t crc_of(const std::string& text) {
  return crc32(std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
}

std::string hex_of(std::span<const std::uint8_t> bytes) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : bytes) text += {kDigits[byte >> 4], kDigits[byte & 15]};
  return text;
}

// Nothing: it is no such text.
std::vector<std::uint8_t> bytes_of(const std::string& hex) {
  std::vector<std::uint8_t> bytes;
  const auto digit = [](char c) { return c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= '0' && c <= '9' ? c - '0' : -1; };
  if (hex.size() % 2 != 0) return {};
  for (std::size_t i = 0; i < hex.size(); i += 2) {
    const int high = digit(hex[i]), low = digit(hex[i + 1]);
    if (high < 0 || low < 0) return {};
    bytes.push_back(static_cast<std::uint8_t>(16 * high + low));
  }
  return bytes;
}

// What a robot announced when it was recorded, as it crossed the air.
std::string text_of_robot(const sogm_swarm::announcement_t& robot) {
  CellAnnouncement message{robot, {}, {}};
  const auto packed = pack(&message);
  if (!packed) throw std::runtime_error("an announcement is longer than a message");
  std::vector<std::uint8_t> bytes;
  encode(*packed, &bytes);
  return hex_of(bytes);
}

std::optional<sogm_swarm::announcement_t> read_robot(const std::string& hex) {
  sogm_swarm::cell_announcement_t packed;
  CellAnnouncement message;
  if (decode(bytes_of(hex), &packed) != Refusal::kNone || unpack(packed, &message) != Refusal::kNone) return {};
  return message.robot;
}

[[noreturn]] void refuse(const std::string& what) {
  throw std::runtime_error("is no whole book of a cell: " + what);
}

std::pair<int, CellKeeper::Record> read_record(const std::string& line, std::int64_t book_seq) {
  std::istringstream in(line);
  int id = -1;
  std::string state, robot, rest;
  CellKeeper::Record record;
  sogm_swarm::header_t& header = record.robot.header;
  in >> id >> state >> record.wish >> record.since >> header.boot >> header.seq >> header.utime >> robot;
  const auto* const found = std::ranges::find(kStates, state);
  if (!in || in >> rest || id < 0 || id > kMaxId || found == std::end(kStates) || record.wish < 0 || record.since < 0 ||
      record.since > book_seq || header.boot < 0 || header.seq < 0 || header.utime < 0)
    refuse("record '" + line.substr(0, 60) + "'");
  header.robot_id = static_cast<std::int16_t>(id);
  record.state = static_cast<Membership>(found - std::begin(kStates));
  if (record.state == Membership::kLeft) return {id, std::move(record)};
  const auto known = read_robot(robot);
  if (!known || known->header.robot_id != id || known->header.boot != header.boot || known->header.seq != header.seq)
    refuse("what robot " + std::to_string(id) + " announced");
  record.robot = *known;
  return {id, std::move(record)};
}

}  // namespace

std::string text_of_book(const CellKeeper::Book& book) {
  std::ostringstream out;
  out << kTitle << '\n'
      << book.cell.x << ' ' << book.cell.y << ' ' << book.seq << ' ' << book.epoch << ' ' << book.records.size()
      << '\n';
  for (const auto& [id, record] : book.records) {
    const sogm_swarm::header_t& header = record.robot.header;
    out << id << ' ' << kStates[static_cast<std::size_t>(record.state)] << ' ' << record.wish << ' ' << record.since
        << ' ' << header.boot << ' ' << header.seq << ' ' << header.utime << ' '
        << (record.state == Membership::kLeft ? "-" : text_of_robot(record.robot)) << '\n';
  }
  const std::string text = out.str();
  return text + std::to_string(crc_of(text)) + '\n';
}

CellKeeper::Book read_book(const std::string& text) {
  const std::size_t last = text.size() < 2 ? 0 : text.rfind('\n', text.size() - 2) + 1;  // the line of the sum
  const std::string body = text.substr(0, last);
  if (text.substr(last) != std::to_string(crc_of(body)) + '\n') refuse("its checksum");
  std::istringstream in(body);
  std::string title, line;
  std::getline(in, title);
  if (title != kTitle) refuse("its first line");
  CellKeeper::Book book;
  std::size_t count = 0;
  in >> book.cell.x >> book.cell.y >> book.seq >> book.epoch >> count;
  if (!in || book.seq < 0 || book.epoch < 0 || book.epoch > book.seq) refuse("its numbers");
  std::getline(in, line);
  while (std::getline(in, line))
    if (!book.records.insert(read_record(line, book.seq)).second) refuse("a robot twice");
  if (book.records.size() != count) refuse("its records are not all there");
  return book;
}

std::vector<CellKeeper::Book> MemoryBookStore::load() {
  std::vector<CellKeeper::Book> books;
  for (const auto& entry : books_) books.push_back(entry.second);
  return books;
}

bool MemoryBookStore::save(const CellKeeper::Book& book) {
  books_[book.cell] = book;
  return true;
}

void FileBookStore::begin(const std::filesystem::path& directory, double cell_m) {
  std::filesystem::create_directories(directory);
  const LockFile lock(lock_in(directory), kOther);
  if (!std::filesystem::exists(directory / kGround)) write_file(directory / kGround, ground_text(cell_m));
}

FileBookStore::FileBookStore(const std::filesystem::path& directory, double cell_m)
    : directory_(directory), lock_(lock_in(directory), kOther) {
  if (!std::filesystem::exists(directory / kGround))
    throw std::runtime_error(directory.string() + ": has no books; --new true begins them, only while no robot flies");
  if (const std::string ground = read_text(directory / kGround); ground != ground_text(cell_m))
    throw std::runtime_error((directory / kGround).string() + ": says '" + ground.substr(0, ground.find('\n')) +
                             "', not " + text_of(cell_m));
}

std::vector<CellKeeper::Book> FileBookStore::load() {
  std::vector<CellKeeper::Book> books;
  for (const auto& entry : std::filesystem::directory_iterator(directory_)) {
    if (entry.path().extension() != kBook) continue;
    try {
      books.push_back(read_book(read_text(entry.path())));
    } catch (const std::exception& error) {
      throw std::runtime_error(entry.path().string() + ": " + error.what());
    }
  }
  std::sort(books.begin(), books.end(), [](const auto& a, const auto& b) { return a.cell < b.cell; });
  return books;
}

bool FileBookStore::save(const CellKeeper::Book& book) {
  const std::string name = "cell_" + std::to_string(book.cell.x) + "_" + std::to_string(book.cell.y) + kBook;
  try {
    write_file(directory_ / name, text_of_book(book));
    return true;
  } catch (const std::exception&) {  // the keeper says so
    return false;
  }
}

}  // namespace swarm
