// The keeper of one cell: it records who is a member, and what each member would like to fly before that is committed.
// Knows neither bus nor clock nor files; its rules are those of cell_protocol.h. All that it knows is its book, which
// is on disk before anything of it is said: a keeper that has crashed goes on as if it had not been there for a while.
#pragma once

#include <cstdint>
#include <functional>
#include <map>

#include "lcmtypes/bus/cell_messages.h"

namespace swarm {

class CellKeeper {
 public:
  struct Record {
    Membership state = Membership::kLeft;
    std::int64_t wish = 0;               // the newest number that was heard: an older one counts no more
    std::int64_t since = 0;              // seq of the book when it became so
    sogm_swarm::announcement_t robot{};  // that this was recorded from; of who has left, only the header
  };
  struct Book {
    Cell cell;
    std::int64_t seq = 0, epoch = 0;  // as in the roster
    std::map<int, Record> records{};  // of every robot that ever was here, by id
  };
  // Whether it is kept and will survive a crash; where not, nothing has changed.
  using Keep = std::function<bool(const Book&)>;

  // What an earlier start kept, or an empty book where there never was one: a book that was lost must not be replaced
  // by an empty one while robots fly.
  explicit CellKeeper(const Book& book) : book_(book) {}

  void receive(const CellAnnouncement& message, const Keep& keep);
  // A member has fallen silent: it leaves what was recorded as its tombstone, until it is heard here again. False: it
  // is no member, or that could not be kept.
  bool expel(int robot_id, const Keep& keep);

  CellRoster roster() const { return roster_of(book_); }
  static CellRoster roster_of(const Book& book);
  const Book& book() const { return book_; }

 private:
  bool change(int robot_id, Record record, bool of_members, const Keep& keep);
  static bool is_listed(const Record& record, const Book& book);

  Book book_;
};

}  // namespace swarm
