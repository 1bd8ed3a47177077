#include "lcmtypes/bus/seal.h"

#include <sodium.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace swarm {
namespace {

constexpr std::array<std::uint8_t, 4> kMark{'S', 'E', 'A', 'L'};
constexpr std::size_t kMacBytes = kSealBytes - kMark.size();
constexpr std::size_t kMaxFile = 4096;

using Mac = std::array<std::uint8_t, kMacBytes>;
using Bytes = std::span<const std::uint8_t>;

void start_sodium() {
  if (::sodium_init() < 0) throw std::runtime_error("libsodium cannot be started");
}

Mac mac_of(Bytes key, std::string_view channel, Bytes message) {
  Mac mac{};
  constexpr std::uint8_t kEnd = 0;
  crypto_generichash_state state;
  ::crypto_generichash_init(&state, key.data(), key.size(), mac.size());
  ::crypto_generichash_update(&state, reinterpret_cast<const std::uint8_t*>(channel.data()), channel.size());
  ::crypto_generichash_update(&state, &kEnd, 1);
  ::crypto_generichash_update(&state, message.data(), message.size());
  ::crypto_generichash_final(&state, mac.data(), mac.size());
  return mac;
}

}  // namespace

Bytes without_seal(Bytes bytes) {
  if (bytes.size() < kSealBytes) return bytes;
  const Bytes message = bytes.first(bytes.size() - kSealBytes);
  return std::ranges::equal(bytes.subspan(message.size(), kMark.size()), kMark) ? message : bytes;
}

SwarmKeys::SwarmKeys(std::string_view text) {
  start_sodium();
  for (std::size_t number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() || line.front() == '#') continue;
    const std::string where = "line " + std::to_string(number) + ": ";
    if (keys_.size() == kMaxKeys) throw std::invalid_argument(where + "at most two keys");
    auto& key = keys_.emplace_back();
    std::size_t written = 0;
    const char* rest = nullptr;
    const bool is_hex =
        ::sodium_hex2bin(key.data(), key.size(), line.data(), line.size(), nullptr, &written, &rest) == 0;
    if (!is_hex || written != key.size() || rest != line.data() + line.size()) {
      throw std::invalid_argument(where + "a key must be 64 hexadecimal digits");
    }
  }
  if (keys_.empty()) throw std::invalid_argument("there must be a key, a line of 64 hexadecimal digits");
}

SwarmKeys SwarmKeys::read(const std::filesystem::path& file) {
  const auto refuse = [&](const std::string& rule) -> SwarmKeys {
    throw std::runtime_error(file.string() + ": " + rule);
  };
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) return refuse("there is no such file; tools/new_key makes a key");
  if (!std::filesystem::is_regular_file(status)) return refuse("must be a regular file with a key");
  if ((status.permissions() & std::filesystem::perms::others_all) != std::filesystem::perms::none) {
    return refuse("others must not read a key; mend with: chmod o-rwx " + file.string());
  }
  std::string text(kMaxFile + 1, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!in.is_open() || in.bad()) return refuse("cannot be read");
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > kMaxFile) return refuse("longer than a file of keys may be (4096 bytes)");
  try {
    return SwarmKeys(text);
  } catch (const std::invalid_argument& rule) {
    return refuse(rule.what());
  }
}

std::string SwarmKeys::fresh() {
  start_sodium();
  std::array<std::uint8_t, kKeyBytes> key{};
  ::randombytes_buf(key.data(), key.size());
  std::array<char, 2 * kKeyBytes + 1> hex{};
  return std::string(::sodium_bin2hex(hex.data(), hex.size(), key.data(), key.size())) + "\n";
}

void SwarmKeys::seal(std::string_view channel, std::vector<std::uint8_t>* bytes) const {
  if (empty()) return;
  const Mac mac = mac_of(keys_.front(), channel, *bytes);
  bytes->insert(bytes->end(), kMark.begin(), kMark.end());
  bytes->insert(bytes->end(), mac.begin(), mac.end());
}

bool SwarmKeys::opens(std::string_view channel, Bytes bytes) const {
  const Bytes message = without_seal(bytes);
  if (message.size() == bytes.size()) return false;
  const Bytes seal = bytes.last(kMacBytes);
  return std::ranges::any_of(keys_, [&](const auto& key) {
    const Mac mac = mac_of(key, channel, message);
    return ::sodium_memcmp(mac.data(), seal.data(), mac.size()) == 0;
  });
}

}  // namespace swarm
