// Audits the promise of the commit protocol from what is on the swarm bus alone: no two committed motions, hover tails
// included, ever come closer than the sum of the radii, without what robots that err announce besides.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// Two robots' committed motions that meet, first seen when one of them was announced.
struct CommitConflict {
  Utime utime{};
  int robot = 0, other = 0;             // ids
  std::int32_t seq = 0, other_seq = 0;  // of the newest trajectory each is bound to
  bool forced = false;                  // one of them was: see commit_protocol.h
};

class CommitAudit {
 public:
  // Of robots whose clocks are off as `clock_offset_ms` of FlightOptions says.
  explicit CommitAudit(double clock_offset_ms = 0.0) : clock_offset_ms_(clock_offset_ms) {}

  // An announcement as it was sent, by a robot whose clock is ahead of the world's; in the order of sending. Anything
  // else is ignored.
  void hear(std::span<const std::uint8_t> bytes, Duration clock_offset = {});
  // The same in any order; finish() then hears them in the order of their header times, which is that of cause and
  // effect where none of what a robot sent is missing. Of a flight that goes on and on the older ones are heard
  // earlier. `sent`: by the world's clock, for robots whose clocks are set in flight; it tells what their stamps are
  // worth.
  void collect(std::span<const std::uint8_t> bytes, std::optional<Utime> sent = {});
  void finish();
  // An OWN_TRAJECTORY of any robot, which says at once what was committed; peers hear of it with the next announcement.
  void hear_own(std::span<const std::uint8_t> bytes);

  int robots() const { return static_cast<int>(robots_.size()); }
  std::int64_t motions() const { return motions_; }  // audited
  std::int64_t forced() const { return forced_; }    // of them
  const std::vector<CommitConflict>& conflicts() const { return conflicts_; }
  // Of each trajectory that was committed before it began, by hear_own(): from when it was announced until then [ms].
  const std::vector<double>& delays_ms() const { return delays_ms_; }

 private:
  struct Announcement {
    sogm_swarm::header_t header{};
    Motion motion;
    Eigen::AlignedBox3d space;    // that it stays in
    std::int32_t forced_seq = 0;  // newest that was committed without everybody's word
    std::optional<Utime> sent;    // by the world's clock, where that counts
    bool is_set_back = false;     // to the world's time

    void set_back(Duration clock_offset);  // to the world's time
    // Bound to one that was forced lately.
    bool is_forced(Utime utime) const;
    // Says something else than `other`: not only that time has gone on.
    bool differs(const Announcement& other) const;
  };
  struct Robot {
    SequenceGate gate;
    Announcement newest;
  };
  // False: it is none.
  bool read(std::span<const std::uint8_t> bytes, Announcement* announcement);
  Refusal read_in_cells(std::span<const std::uint8_t> bytes, sogm_swarm::announcement_t* message);
  void hear(const Announcement& announcement);
  void hear_collected(std::size_t count);  // so many, the oldest

  static constexpr std::size_t kMostCollected = 100'000;  // half an hour of four robots; 100 MB

  double clock_offset_ms_;

  std::map<int, double> radii_m_;  // of the robots, by id: the least announced; at times they announce errors with it
  std::map<int, SequenceGate> copies_;
  std::map<int, Robot> robots_;
  std::map<int, Announcement> newest_;   // collected
  std::vector<Announcement> collected_;  // without repetitions
  std::int64_t motions_ = 0, forced_ = 0;
  std::vector<CommitConflict> conflicts_;
  std::map<int, std::pair<std::int32_t, std::int32_t>> committed_;  // newest next trajectory: boot and seq, by robot
  std::vector<double> delays_ms_;
};

// All announcements of a log of the swarm bus. `clock_offset_ms`: as in FlightOptions. Throws std::runtime_error with
// path and reason.
CommitAudit audit_log(const std::filesystem::path& path, double clock_offset_ms = 0.0);

}  // namespace swarm
