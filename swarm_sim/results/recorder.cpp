#include "swarm_sim/results/recorder.h"

#include <regex>

#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

constexpr int kDecimals = 6;
constexpr int kSwarmBus = -1;  // among the robots' ids

}  // namespace

void remove_results(const std::filesystem::path& directory) {
  static const std::regex results(
      "(trace|commanded)\\.csv|report\\.json|(swarm|robot[0-9]+)\\.lcm|(robot[0-9]+-[a-z]+|keeper)\\.(log|cfg)");
  std::vector<std::filesystem::path> found;
  for (const auto& entry : std::filesystem::directory_iterator(directory)) {
    if (entry.is_regular_file() && std::regex_match(entry.path().filename().string(), results))
      found.push_back(entry.path());
  }
  for (const std::filesystem::path& file : found) std::filesystem::remove(file);
}

TraceWriter::TraceWriter(const std::filesystem::path& path) : file_(path), out_(file_.temporary(), std::ios::binary) {
  out_ << "t,robot,x,y,z,vx,vy,vz,ax,ay,az\n";
  if (!out_) fail_to_write(file_.path());
}

void TraceWriter::write(double t_s, int robot_id, const MotionState& state) {
  line_.clear();
  append_fixed(t_s, kDecimals, &line_);
  line_ += ',';
  line_ += std::to_string(robot_id);
  for (const Eigen::Vector3d* vector : {&state.position, &state.velocity, &state.acceleration}) {
    for (const double value : *vector) {
      line_ += ',';
      append_fixed(value, kDecimals, &line_);
    }
  }
  line_ += '\n';
  if (!(out_ << line_)) fail_to_write(file_.path());
}

void TraceWriter::close() {
  out_.close();
  if (!out_) fail_to_write(file_.path());
  file_.commit();
}

FlightTrace::FlightTrace(const std::filesystem::path& directory, bool is_followed_exactly)
    : flown_(directory / "trace.csv") {
  if (!is_followed_exactly) commanded_.emplace(directory / "commanded.csv");
}

void FlightTrace::write(double t_s, const Simulation& simulation) {
  for (const Vehicle& vehicle : simulation.vehicles()) {
    flown_.write(t_s, vehicle.id(), vehicle.state());
    if (commanded_) commanded_->write(t_s, vehicle.id(), vehicle.reference());
  }
}

void FlightTrace::close() {
  flown_.close();
  if (commanded_) commanded_->close();
}

BusLog::Log::Log(const std::filesystem::path& path) : file(path), log(file.temporary().string(), "w") {
  if (!log.good()) fail_to_write(file.path());
}

BusLog::BusLog(const std::filesystem::path& directory, const std::vector<int>& robot_ids) {
  logs_.try_emplace(kSwarmBus, directory / "swarm.lcm");
  for (const int id : robot_ids) logs_.try_emplace(id, directory / ("robot" + std::to_string(id) + ".lcm"));
}

void BusLog::write(BusId bus, int robot_id, Utime utime, std::string_view channel,
                   std::span<const std::uint8_t> bytes) {
  Log& log = logs_.at(bus == BusId::kSwarm ? kSwarmBus : robot_id);
  lcm::LogEvent event{};
  event.timestamp = to_us(utime);
  event.channel = channel;
  event.datalen = static_cast<std::int32_t>(bytes.size());
  event.data = const_cast<std::uint8_t*>(bytes.data());  // only read
  if (log.log.writeEvent(&event) != 0) fail_to_write(log.file.path());
}

// The data must be on its way to the disk before the name appears; the stream itself is closed by its destructor.
void BusLog::close() {
  for (auto& [id, log] : logs_) {
    if (std::fflush(log.log.getFilePtr()) != 0) fail_to_write(log.file.path());
    log.file.commit();
  }
  logs_.clear();
}

}  // namespace swarm
