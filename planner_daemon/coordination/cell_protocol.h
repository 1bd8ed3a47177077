// Swarms beyond one roster: the commit protocol (commit_protocol.h) among the members of the cells that a motion
// touches. Knows neither bus nor clock nor files; cell_protocol_test searches its states exhaustively on small cases.
//
// The ground is cut into cells (cell.h), each with a keeper (cell_keeper.h). A motion touches a cell where it comes
// closer to it than the radius and half the separation: spheres that meet share a cell. In all its cells a robot
// announces its whole state, and with it what it wishes of each cell, by which number, and the epoch of the newest
// roster of it that it knows. A keeper announces its roster: who is a member by which wish since which epoch, and what
// is recorded. Rosters are numbered (`seq`), only newer ones are read; an epoch is the number of the newest one that
// changed who is a member.
//  1. Join: before a robot proposes what touches a cell, it wishes to be a member, by a number that is never used
//     again; after a restart, and when it was expelled, by a new one. It is listed while the newest roster that it
//     knows has exactly this wish. It is in while, besides, the newest announcement of each other member echoes its
//     boot, and an epoch as new as its own entry: so it was said by one that knew of the wish.
//  2. Its peers are the members of all cells where it is listed, and of no others is anything read. Among them the
//     rules of commit_protocol.h hold, but for the 8th. Who is no peer any more is forgotten, with all that it said and
//     was answered.
//  3. Record: a keeper records what each member is bound to and has announced. Its book is on disk before it is said.
//  4. Commit P when those rules permit it and the robot is in every cell that P touches, all members of these have
//     judged P, and the keeper of each has recorded it under the robot's wish.
//  5. Leave a cell that neither C nor P nor what the robot has lately wanted to fly touches any more, and say so until
//     a roster shows it. For which cells it wishes is on disk before it is said: after a restart it leaves those that C
//     does not touch.
//  6. Expel: a keeper may expel any member at any time, and does it when one is silent. C and P, as recorded last, stay
//     in the roster as its tombstone: members keep off both, each as if it were flown, until the keeper hears that the
//     robot has left, or of a new wish. By the old one nothing is recorded any more.
//  7. What is forced (rules 6 and 7 there) asks no keeper either, nor does where a robot stands when it is switched on.
//
// Why it is safe, but for what is forced. Let A of robot i and B of robot j, both committed, meet in a cell, and A be
// recorded there first. The roster by which j commits B is younger than both records. Robot i has not left, for A
// touches the cell. If it was expelled, A is in its tombstone, and B keeps off that. If it is a member, it is a peer of
// j, and has judged B knowing of the wish by which B is committed. From then on i waits for j, as j does for i, and
// keeps what it acknowledged: the rules of the pair hold between A and B, until i forgets j. That is when a roster
// shows j expelled: either B is in the tombstone, or it was not recorded; then it is judged anew, by who knows of j's
// new wish. Or it is when i itself is no member any more, as it has left, was expelled or has restarted: by its new
// wish it is in only after j, knowing of that wish, has told it B, and whatever j was answered before the restart is
// void by i's boot. Rosters and announcements may come late, twice or never: numbers only grow. A keeper that restarts
// has its book.
//
// Who waits for whom: as in one roster, but only members of common cells for each other, and for a dead one until it is
// expelled. While a keeper is silent, nobody joins its cell, and nothing that touches the cell is committed; robots
// there come to rest where they promised to. A book that is lost must not be begun anew while robots fly.
//
// A second keeper of a cell, with a book of its own, is a mistake that no rule makes safe over any network: robots that
// know one keeper each do not know of each other. So a keeper only listens at first, for as long as ten rosters of
// another are apart (`KeeperConfig::listen_s`), and the later of two falls silent for good when it hears the other, for
// its book knows nothing of what that one recorded meanwhile. To robots that is a keeper that is silent: nothing that
// touches the cell is committed by its last roster, for nothing is recorded there any more. They go on by the other's
// once one is newer by its number: it shows them as members when that keeper has heard them, with what they are bound
// to, and from then on nobody there commits what they have not judged. That an epoch which they echo is one of the
// silent keeper's makes nobody commit: who echoes it has to judge as well, and judges peers alone. What remains is what
// robots commit that know one keeper each, before one of these hears the other: while it begins, if all that the other
// says is lost.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "planner_daemon/coordination/flight_agreement.h"

namespace swarm {

class CellProtocol : public FlightAgreement {
 public:
  using CellsOf = std::function<std::set<Cell>(const Motion& motion, Utime from, double reach_m)>;
  struct Rules {
    CommitProtocol::Rules robot;  // its roster is not used
    CellsOf cells_of;             // as cells_touched()
  };

  explicit CellProtocol(const Rules& rules);

  void start(const Motion& motion, std::int32_t forced_seq = 0, const Standings& kept = {}) override;
  // kWaiting also when the robot is not in all cells that it touches: it will be, if the candidate is proposed again
  // soon.
  Rejection propose(Utime now, const Trajectory& candidate, const Keep& keep, bool urgent = false) override;
  // Nothing is kept: what was answered is void after a restart.
  void receive(Utime now, const CellAnnouncement& message, const Keep& keep) override;
  // Of a cell that the robot has to do with, newer than all before; others change nothing.
  void receive(const CellRoster& roster);
  // Switches to and withdraws what is due, wishes for cells and leaves them.
  void advance(Utime now, const Keep& keep) override;
  // Also of what is recorded in the cells.
  void set_clock(Utime now, Duration step) override;
  bool commit(const Keep& keep) override;

  struct Place {  // a cell that the robot has to do with
    std::int64_t wish = 0;
    bool wishes = false;
    std::optional<CellRoster> roster{};  // the newest that is known
  };
  // Members of its cells wait for its answers, for a newer epoch of it where one wants to join, and its keepers for
  // what it wishes; it waits for all of them while it is not in where it wishes to be.
  CommitProtocol::News take_news() override;
  bool is_awaited(Utime now) const override;
  Utime due_utime(Utime now) const override;

  CellAnnouncement state() const override;
  CellAnnouncement promise() const override { return state(); }
  int told_about(const CellAnnouncement& message) const override;
  std::vector<sogm_swarm::announcement_t> tombstones() const override;  // of who was expelled
  const CommitProtocol& robot() const override { return protocol_; }
  CommitProtocol& robot() override { return protocol_; }
  bool is_in(const Cell& cell) const;
  const std::map<Cell, Place>& places() const { return places_; }

 protected:
  // What is known besides, for who looks at whole states.
  const std::map<int, Standings>& peers_cells() const { return peers_cells_; }  // by the newest announcement of each
  Utime wanted_until() const { return wanted_until_; }  // so long it wishes for the cells of what it has proposed last

 private:
  const CellRoster::Entry* own_entry(const Place& place) const;  // by its newest wish; null: there is none
  bool is_listed(const Place& place) const;
  bool is_expelled(const Place& place) const;
  bool has_left(const Place& place) const;
  double reach_m() const { return protocol_.radius_m() + rules_.robot.separation_m / 2; }
  sogm_swarm::announcement_t of_roster(const CellAnnouncement& message) const;
  std::set<Cell> cells_of(const Trajectory& trajectory) const;
  std::set<Cell> needed_cells(Utime now) const;
  bool is_granted() const;
  void find_peers();  // by the rosters and wishes, whenever these have changed
  void hold_back();   // what is pending, until it is granted: whenever anything has changed

  Rules rules_;
  CommitProtocol protocol_;
  std::int64_t next_wish_;
  std::map<Cell, Place> places_;
  std::set<Cell> wanted_;  // by what was proposed last
  Utime wanted_until_{};
  std::map<int, Standings> peers_cells_;
  bool news_ = false, answers_ = false;
};

}  // namespace swarm
