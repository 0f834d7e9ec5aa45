#include "cli/change_text.h"

#include "cli/geometry_json.h"
#include "cli/text_table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <span>

namespace mapp {
namespace {

std::string FormatCenter(const OrientedBox& box_map) {
  const Eigen::Vector3d& center_map = box_map.T_frame_box.translation();
  return fmt::format("{:.2f} {:.2f} {:.2f}", center_map.x(), center_map.y(), center_map.z());
}

std::string FormatSize(const OrientedBox& box_map) {
  return fmt::format("{:.2f} x {:.2f} x {:.2f}", box_map.size_m.x(), box_map.size_m.y(), box_map.size_m.z());
}

/// "from -> to" for what has moved.
std::string FormatPlace(const ChangeSummary& change) {
  if (change.kind != ChangeKind::kMoved) return FormatCenter(LatestBox(change));
  return FormatCenter(*change.box_map_before) + " -> " + FormatCenter(*change.box_map_after);
}

std::string FormatNumPoints(const ChangeSummary& change) {
  if (change.kind == ChangeKind::kAppeared) return std::to_string(change.points_after.size());
  if (change.kind == ChangeKind::kVanished) return std::to_string(change.points_before.size());
  return fmt::format("{} -> {}", change.points_before.size(), change.points_after.size());
}

/// The first few of them, so that a line stays a line.
std::string FormatFewSessions(const std::vector<uint64_t>& session_ids) {
  constexpr size_t kMaxListed = 6;
  if (session_ids.size() <= kMaxListed) return fmt::format("{}", fmt::join(session_ids, " "));
  return fmt::format("{} and {} more", fmt::join(std::span(session_ids).first(kMaxListed - 1), " "),
                     session_ids.size() - (kMaxListed - 1));
}

void AddBoxRows(const std::optional<OrientedBox>& box_map, const std::string& when, TextTable& table) {
  if (!box_map) return;
  const Eigen::Quaterniond& q = box_map->T_frame_box.rotation();
  table.AddRow({fmt::format("centre {} (m)", when), FormatCenter(*box_map)});
  table.AddRow({fmt::format("size {} (m)", when), FormatSize(*box_map)});
  table.AddRow({fmt::format("turn {} (qw qx qy qz)", when),
                fmt::format("{:.4f} {:.4f} {:.4f} {:.4f}", q.w(), q.x(), q.y(), q.z())});
}

void AddPointRows(const std::vector<uint64_t>& points, const std::string& when, TextTable& table) {
  constexpr size_t kNumInLine = 12;
  for (size_t first = 0; first < points.size(); first += kNumInLine) {
    const auto line = std::span(points).subspan(first, std::min(kNumInLine, points.size() - first));
    table.AddRow({first == 0 ? fmt::format("points {} ({})", when, points.size()) : std::string(),
                  fmt::format("{}", fmt::join(line, " "))});
  }
}

/// Null without a box.
void AppendBox(const std::optional<OrientedBox>& box_map, const char* key, JsonWriter& json) {
  json.Key(key);
  if (!box_map) {
    json.Null();
    return;
  }
  json.BeginObject();
  AppendBoxFields(*box_map, json);
  json.EndObject();
}

void AppendIds(const std::vector<uint64_t>& ids, const char* key, JsonWriter& json) {
  json.Key(key).BeginArray();
  for (const uint64_t id : ids) json.Value(id);
  json.EndArray();
}

}  // namespace

const OrientedBox& LatestBox(const ChangeSummary& change) {
  return change.box_map_after ? *change.box_map_after : *change.box_map_before;
}

std::string FormatChangeTable(const std::vector<ChangeSummary>& changes) {
  TextTable table({{"id", Align::kRight},
                   {"kind"},
                   {"status"},
                   {"confidence", Align::kRight},
                   {"where (m)"},
                   {"size (m)"},
                   {"happened after (UTC)"},
                   {"and before"},
                   {"points", Align::kRight},
                   {"sessions"}});
  for (const ChangeSummary& change : changes) {
    table.AddRow({std::to_string(change.id), NameOf(kWorldChangeKinds, change.kind),
                  NameOf(kWorldChangeStatuses, change.status), fmt::format("{:.2f}", change.confidence),
                  FormatPlace(change), FormatSize(LatestBox(change)), FormatUnixTime(change.after_unix_ns),
                  FormatUnixTime(change.before_unix_ns), FormatNumPoints(change),
                  FormatFewSessions(change.session_ids)});
  }
  return table.Format();
}

std::string FormatChange(const ChangeSummary& change) {
  TextTable table({{"change"}, {std::to_string(change.id)}});
  table.AddRow({"kind", NameOf(kWorldChangeKinds, change.kind)});
  table.AddRow({"status", NameOf(kWorldChangeStatuses, change.status)});
  table.AddRow({"confidence", fmt::format("{:.3f}", change.confidence)});
  table.AddRow({"happened after (UTC)", FormatUnixTime(change.after_unix_ns)});
  table.AddRow({"and before (UTC)", FormatUnixTime(change.before_unix_ns)});
  table.AddRow({"first seen (UTC)", FormatUnixTime(change.first_seen_unix_ns)});
  table.AddRow({"last seen (UTC)", FormatUnixTime(change.last_seen_unix_ns)});
  table.AddRow({"sessions", fmt::format("{}", fmt::join(change.session_ids, " "))});
  table.AddRow({"found at revision", std::to_string(change.detected_revision)});
  table.AddRow({"applied at revision", change.applied_revision == 0 ? "-" : std::to_string(change.applied_revision)});
  AddBoxRows(change.box_map_before, "before", table);
  AddBoxRows(change.box_map_after, "after", table);
  AddPointRows(change.points_before, "before", table);
  AddPointRows(change.points_after, "after", table);
  return table.Format();
}

void AppendBoxFields(const OrientedBox& box_map, JsonWriter& json) {
  AppendPose(box_map.T_frame_box, "pose_map_box", json);
  AppendPoint(box_map.size_m, "size_m", json);
}

void AppendChangeFields(const ChangeSummary& change, JsonWriter& json) {
  json.Field("id", change.id).Field("kind", NameOf(kWorldChangeKinds, change.kind));
  json.Field("status", NameOf(kWorldChangeStatuses, change.status)).Field("confidence", change.confidence);
  json.Field("after_unix_ns", change.after_unix_ns).Field("before_unix_ns", change.before_unix_ns);
  json.Field("first_seen_unix_ns", change.first_seen_unix_ns).Field("last_seen_unix_ns", change.last_seen_unix_ns);
  json.Field("detected_revision", change.detected_revision).Field("applied_revision", change.applied_revision);
  AppendIds(change.session_ids, "session_ids", json);
  AppendIds(change.points_before, "points_before", json);
  AppendIds(change.points_after, "points_after", json);
}

void AppendChange(const ChangeSummary& change, JsonWriter& json) {
  json.BeginObject();
  AppendChangeFields(change, json);
  AppendBox(change.box_map_before, "box_before", json);
  AppendBox(change.box_map_after, "box_after", json);
  json.EndObject();
}

void AppendChanges(const std::vector<ChangeSummary>& changes, JsonWriter& json) {
  json.Key("changes").BeginArray();
  for (const ChangeSummary& change : changes) AppendChange(change, json);
  json.EndArray();
}

}  // namespace mapp
