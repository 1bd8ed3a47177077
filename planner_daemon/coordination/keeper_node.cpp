#include "planner_daemon/coordination/keeper_node.h"

#include <spdlog/spdlog.h>

#include <cmath>
#include <set>
#include <utility>

#include "lcmtypes/bus/cell_channels.h"
#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr Duration kMaxAge = 1s;  // of announcements
constexpr Duration kLook = 5ms;   // at all cells: so long news may wait, and no roster is said more often
constexpr Duration kSpoken = 1s;  // after the last announcement in a cell its roster is repeated
constexpr Duration kOther = 2s;   // after the last roster of another keeper it is gone
constexpr std::ptrdiff_t kMostCells = 10'000;

std::string name_of(const Cell& cell) {
  return std::to_string(cell.x) + "," + std::to_string(cell.y);
}

}  // namespace

void declare(OptionSet& options, KeeperConfig& config) {
  options.add("keeper-id", &config.keeper_id, 0, 32767, "", "this keeper, among those of other parts of the ground");
  options.add("cells", &config.cell_m, 1, 1000, "m", "edge of the cells, the same for all robots and keepers");
  options.add("space-min", &config.space_min, -1e5, 1e5, "m",
              "flight space, lower corner: all cells that it has a part of are kept by this keeper, and by no other");
  options.add("space-max", &config.space_max, -1e5, 1e5, "m", "flight space, upper corner");
  options.add("listen", &config.listen_s, 0, 60, "s",
              "after its start it says and records nothing for so long: if it hears another keeper of its cells "
              "meanwhile, or later one that began earlier, it leaves them to that one");
  options.add("roster-period", &config.roster_s, 0.01, 10, "s",
              "repetition of rosters, while anybody speaks in a cell");
  options.add("expel-after", &config.expel_after_s, 0.1, 1e6, "s",
              "who was not heard for so long is no member any more");
  options.add("clock-error", &config.clock_error_s, 0, 1, "s", "messages from further in the future are refused");
  options.add("state-dir", &config.state_dir,
              "directory, in memory as /run, where books survive a crash of the daemon; none: they do not");
}

void verify(const KeeperConfig& config) {
  if (!(config.cell_m >= 1.0)) throw OptionError("--cells: " + text_of(config.cell_m) + " m; must be at least 1 m");
  if ((config.space_min.array() >= config.space_max.array()).any())
    throw OptionError("--space-min: must be below --space-max on every axis");
  const Eigen::Vector2d cells = (config.space_max - config.space_min).head<2>() / config.cell_m + Eigen::Vector2d(1, 1);
  if (cells.prod() > kMostCells) {
    throw OptionError("--space-min, --space-max: " + text_of(std::ceil(cells.prod())) + " cells; at most " +
                      std::to_string(kMostCells));
  }
}

std::set<Cell> cells_kept(const KeeperConfig& config) {
  const Eigen::Vector2i first = (config.space_min.head<2>() / config.cell_m).array().floor().cast<int>();
  const Eigen::Vector2i end = (config.space_max.head<2>() / config.cell_m).array().ceil().cast<int>();
  std::set<Cell> cells;
  for (std::int32_t x = first.x(); x < end.x(); ++x)
    for (std::int32_t y = first.y(); y < end.y(); ++y) cells.insert({x, y});
  return cells;
}

KeeperNode::KeeperNode(const KeeperConfig& config, BookStore& store, std::int32_t boot)
    : config_((verify(config), config)), store_(store), headers_(config.keeper_id, boot), boot_(boot) {
  for (const CellKeeper::Book& book : store.load()) cells_.try_emplace(book.cell, Kept{CellKeeper(book)});
  for (const Cell& cell : cells_kept(config_)) cells_.try_emplace(cell, Kept{CellKeeper(CellKeeper::Book{cell})});
}

std::vector<Subscription> KeeperNode::subscriptions() const {
  std::vector<Subscription> subscriptions;
  std::set<Cell> cells;
  for (const auto& entry : cells_) cells.insert(entry.first);
  for (const std::string& channel : heard_on(cells)) subscriptions.push_back({BusId::kSwarm, channel});
  return subscriptions;
}

void KeeperNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) {
  const Refusal refusal = kind_of(channel) == channel::kCellRoster ? on_keeper(now, bytes) : on_robot(now, bytes);
  if (refusal != Refusal::kNone) refused_.count(refusal);
}

// An announcement may come in each cell that it mentions: the first copy is for all that are kept here.
Refusal KeeperNode::on_robot(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::cell_announcement_t packed;
  CellAnnouncement message;
  Refusal refusal = decode(bytes, &packed);
  if (refusal != Refusal::kNone || !keeps(now)) return refusal;
  SequenceGate& gate = gates_[packed.header.robot_id];
  if (!gate.is_newer(packed.header)) return Refusal::kNone;
  const auto from_anybody = [](const sogm_swarm::cell_announcement_t&) { return Refusal::kNone; };
  refusal = admit(packed, from_anybody, {now, kMaxAge, to_duration(config_.clock_error_s)}, gate);
  if (refusal == Refusal::kNone) refusal = unpack(packed, &message);
  if (refusal != Refusal::kNone) return refusal;
  for (const auto& entry : message.cells) {
    const auto found = cells_.find(entry.first);
    if (found == cells_.end()) continue;
    found->second.heard[packed.header.robot_id] = found->second.newest = now;
    found->second.keeper.receive(message, keeper());
  }
  return Refusal::kNone;
}

bool KeeperNode::keeps(Utime now) const {
  return began_ && now - *began_ >= to_duration(config_.listen_s) && !gives_way_;
}

bool KeeperNode::is_own(const sogm_swarm::header_t& header) const {
  return header.robot_id == config_.keeper_id && header.boot == boot_ && header.seq <= said_;
}

Refusal KeeperNode::on_keeper(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::cell_roster_t packed;
  CellRoster roster;
  const auto from_another = [this](const sogm_swarm::cell_roster_t& m) {
    return is_own(m.header) ? Refusal::kRobot : Refusal::kNone;
  };
  Refusal refusal = decode(bytes, &packed);
  if (refusal == Refusal::kNone)
    refusal = admit(packed, from_another, {now, kMaxAge, to_duration(config_.clock_error_s)}, AnyOrder());
  if (refusal == Refusal::kRobot) return Refusal::kNone;  // multicast returns our own
  if (refusal == Refusal::kNone) refusal = unpack(packed, &roster);
  // What an earlier start said may still be under way.
  if (refusal != Refusal::kNone || !began_ || to_utime(packed.header.utime) <= *began_) return refusal;
  const auto began = [](int id, std::int32_t boot) { return std::pair(boot, id); };
  other_ = {packed.header.robot_id, roster.cell, now};
  if (gives_way_ || began(config_.keeper_id, boot_) < began(packed.header.robot_id, packed.header.boot)) return refusal;
  gives_way_ = true;
  spdlog::error("keeper {} began earlier and keeps cell {} as well: this one says and records nothing any more",
                other_->id, name_of(other_->cell));
  return refusal;
}

CellKeeper::Keep KeeperNode::keeper() {
  return [this](const CellKeeper::Book& book) {
    CellRoster roster = CellKeeper::roster_of(book);
    sogm_swarm::header_t header{};
    const bool is_kept = pack(header, &roster).has_value() && store_.save(book);
    passed_over_ += is_kept ? 0 : 1;
    return is_kept;
  };
}

void KeeperNode::expel_silent(Utime now, Kept* kept) {
  std::vector<int> silent;
  for (const auto& [id, record] : kept->keeper.book().records) {
    if (record.state != Membership::kMember) continue;
    const Utime heard = kept->heard.try_emplace(id, now).first->second;  // after a restart
    if (now - heard > to_duration(config_.expel_after_s)) silent.push_back(id);
  }
  for (const int id : silent) (void)kept->keeper.expel(id, keeper());
}

void KeeperNode::announce(Utime now, const Cell& cell, Kept* kept, Outbox& outbox) {
  CellRoster roster = kept->keeper.roster();
  kept->said_seq = roster.seq;
  kept->roster.done(now);
  const sogm_swarm::header_t header = headers_.next(now);
  said_ = header.seq;
  if (const auto packed = pack(header, &roster))
    outbox.publish(BusId::kSwarm, channel_of(channel::kCellRoster, cell), *packed);
}

Utime KeeperNode::step(Utime now, Outbox& outbox) {
  if (!began_) began_ = now;
  if (now < look_.due(now, kLook)) return look_.due(now, kLook);
  look_.done(now);
  if (!keeps(now)) return look_.due(now, kLook);
  for (auto& [cell, kept] : cells_) {
    expel_silent(now, &kept);
    const bool is_new = kept.keeper.book().seq != kept.said_seq && kept.keeper.book().seq > 0;
    const bool is_spoken_in = now - kept.newest < kSpoken && kept.newest != Utime();
    if (is_new || (is_spoken_in && now >= kept.roster.due(now, to_duration(config_.roster_s))))
      announce(now, cell, &kept, outbox);
  }
  return look_.due(now, kLook);
}

bool KeeperNode::on_clock_step(Utime, Duration step) {
  if (began_) *began_ += step;
  if (other_) other_->heard += step;
  for (auto& entry : cells_) {
    Kept& kept = entry.second;
    for (auto& heard : kept.heard) heard.second += step;
    if (kept.newest != Utime()) kept.newest += step;
  }
  return true;
}

Activity KeeperNode::activity(Utime now) const {
  if (gives_way_)
    return {true, "keeps nothing: another keeper began earlier; end one of them",
            "keeper " + std::to_string(other_->id) + " was heard in cell " + name_of(other_->cell)};
  if (other_ && now - other_->heard < kOther)
    return {true, "another keeper speaks in its cells; it must be ended",
            "keeper " + std::to_string(other_->id) + " was heard in cell " + name_of(other_->cell)};
  int members = 0, expelled = 0;
  for (const auto& [cell, kept] : cells_) {
    for (const auto& [id, record] : kept.keeper.book().records) {
      members += record.state == Membership::kMember ? 1 : 0;
      expelled += record.state == Membership::kExpelled ? 1 : 0;
    }
  }
  if (passed_over_ > 0)
    return {true, "passed over what robots announced: a roster is full, or --state-dir cannot be written",
            std::to_string(passed_over_) + " times"};
  return {.text = "keeps " + std::to_string(cells_.size()) + " cells: " + std::to_string(members) + " members" +
                  (expelled > 0 ? ", " + std::to_string(expelled) + " who fell silent" : "")};
}

}  // namespace swarm
