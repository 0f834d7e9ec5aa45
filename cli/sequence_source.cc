#include "cli/sequence_source.h"

#include "cli/visit_spec.h"
#include "sim/room.h"

#include <fmt/format.h>

#include <charconv>
#include <string_view>
#include <utility>

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

Status CheckSequenceName(const std::string& name) {
  if (!name.starts_with(kSimulated) || ParseRoomSpec(name)) return absl::OkStatus();
  if (name.starts_with(kRoom)) {
    return absl::InvalidArgumentError(fmt::format("{}: sim:room/SESSION or sim:room:SEED/SESSION expected", name));
  }
  return ParseVisitSpec(name).status();
}

StatusOr<std::unique_ptr<Sequence>> OpenSequenceSource(const std::string& name) {
  MAPP_RETURN_IF_ERROR(CheckSequenceName(name));
  if (!name.starts_with(kSimulated)) return OpenSequence(name);
  if (const std::optional<RoomSpec> room = ParseRoomSpec(name)) {
    sim::RoomOptions options;
    options.seed = room->seed;
    options.session = static_cast<int>(room->session);
    return sim::MakeRoomSequence(options);
  }
  MAPP_ASSIGN_OR_RETURN(const VisitSpec spec, ParseVisitSpec(name));
  MAPP_ASSIGN_OR_RETURN(std::shared_ptr<const sim::Simulation> simulation, sim::Simulate(spec.simulation));
  return sim::OpenVisit(std::move(simulation), spec.user, spec.images);
}

}  // namespace mapp
