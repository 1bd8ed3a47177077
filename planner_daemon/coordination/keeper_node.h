// The keepers of all cells of a part of the ground, as a node of one process: each by the rules of cell_protocol.h.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"
#include "planner_daemon/coordination/book_store.h"
#include "planner_daemon/coordination/cell_keeper.h"

namespace swarm {

struct KeeperConfig {
  int keeper_id = 0;
  double cell_m = 8.0;  // edge of the cells
  // Flight space, W [m]: all cells that it has a part of are kept here, and nowhere else.
  Eigen::Vector3d space_min = {-16, -16, 0}, space_max = {16, 16, 4};
  double listen_s = 0.5;        // after its start it says and records nothing: another may keep the cells
  double roster_s = 0.05;       // repetition of rosters
  double expel_after_s = 2.0;   // who was not heard for so long
  double clock_error_s = 0.01;  // messages from further in the future are refused
  std::string state_dir;        // where books survive a crash; empty: nowhere
};

void declare(OptionSet& options, KeeperConfig& config);
// Throws OptionError on what cannot work.
void verify(const KeeperConfig& config);

// All cells that a keeper keeps: two may share a border, but no cell.
std::set<Cell> cells_kept(const KeeperConfig& config);

// Another keeper of the same cells is a mistake (cell_protocol.h): the one that began later says and records nothing
// from when it hears the other, until it is started again; both say so.
class KeeperNode : public Node {
 public:
  // Goes on with what `store` kept, which must outlive the node. `boot` grows at every start, of whichever keeper.
  KeeperNode(const KeeperConfig& config, BookStore& store, std::int32_t boot);

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;
  bool on_clock_step(Utime now, Duration step) override;
  Activity activity(Utime now) const override;

  const RefusalCounts& refused() const { return refused_; }
  // Changes that were not made: the cell's roster would no longer fit a frame, or its book could not be saved.
  std::int64_t passed_over() const { return passed_over_; }

 private:
  struct Kept {
    CellKeeper keeper;
    std::map<int, Utime> heard{};  // who mentioned the cell last when
    Utime newest{};                // of them
    std::int64_t said_seq = -1;    // of the roster that was said last
    Recurring roster{};
  };
  Refusal on_robot(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_keeper(Utime now, std::span<const std::uint8_t> bytes);
  bool is_own(const sogm_swarm::header_t& header) const;
  bool keeps(Utime now) const;  // and speaks
  CellKeeper::Keep keeper();
  void expel_silent(Utime now, Kept* kept);
  void announce(Utime now, const Cell& cell, Kept* kept, Outbox& outbox);

  KeeperConfig config_;
  BookStore& store_;
  HeaderSource headers_;
  std::int32_t boot_;
  std::int64_t said_ = -1;      // header.seq of the newest roster
  std::optional<Utime> began_;  // none: before the first step
  struct Other {                // keeper
    int id;
    Cell cell;
    Utime heard;
  };
  std::optional<Other> other_;  // that was heard last
  bool gives_way_ = false;      // to it
  std::map<Cell, Kept> cells_;
  std::map<int, SequenceGate> gates_;  // by robot
  RefusalCounts refused_;
  std::int64_t passed_over_ = 0;
  Recurring look_;
};

}  // namespace swarm
