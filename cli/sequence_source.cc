#include "cli/sequence_source.h"

#include "sim/room.h"

#include <fmt/format.h>

#include <charconv>
#include <limits>
#include <string_view>

namespace mapp {
namespace {

constexpr std::string_view kSimulated = "sim:";
constexpr std::string_view kRoom = "sim:room";

/// Digits only, all of `text`.
template <typename T>
std::optional<T> ParseUnsigned(std::string_view text) {
  T value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

std::optional<RoomSpec> ParseRoomSpec(const std::string& text) {
  const size_t slash = text.rfind('/');
  if (!text.starts_with(kRoom) || slash == std::string::npos) return std::nullopt;
  RoomSpec room;
  const std::optional<uint32_t> session = ParseUnsigned<uint32_t>(std::string_view(text).substr(slash + 1));
  if (!session || *session > RoomSpec::kMaxSession) return std::nullopt;
  room.session = *session;
  const std::string_view middle = std::string_view(text).substr(kRoom.size(), slash - kRoom.size());
  if (middle.empty()) return room;
  const std::optional<uint64_t> seed = ParseUnsigned<uint64_t>(middle.substr(1));
  if (middle.front() != ':' || !seed) return std::nullopt;
  room.seed = *seed;
  return room;
}

StatusOr<std::unique_ptr<Sequence>> OpenSequenceSource(const std::string& name) {
  if (!name.starts_with(kSimulated)) return OpenSequence(name);
  const std::optional<RoomSpec> room = ParseRoomSpec(name);
  if (!room) {
    return absl::InvalidArgumentError(
        fmt::format("sequence: {} is not sim:room/SESSION or sim:room:SEED/SESSION", name));
  }
  sim::RoomOptions options;
  options.seed = room->seed;
  options.session = static_cast<int>(room->session);
  return sim::MakeRoomSequence(options);
}

}  // namespace mapp
