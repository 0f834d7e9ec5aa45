#pragma once

#include "cli/change_info.h"
#include "eval/harness/choices.h"
#include "text/json_writer.h"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

inline constexpr std::array kWorldChangeKinds = {Choice<ChangeKind>{"appeared", ChangeKind::kAppeared},
                                                 Choice<ChangeKind>{"vanished", ChangeKind::kVanished},
                                                 Choice<ChangeKind>{"moved", ChangeKind::kMoved}};
inline constexpr std::array kWorldChangeStatuses = {Choice<ChangeStatus>{"proposed", ChangeStatus::kProposed},
                                                    Choice<ChangeStatus>{"accepted", ChangeStatus::kAccepted},
                                                    Choice<ChangeStatus>{"rejected", ChangeStatus::kRejected}};

/// Where the thing is, or last was.
const OrientedBox& LatestBox(const ChangeSummary& change);

/// A table with a line a change.
std::string FormatChangeTable(const std::vector<ChangeSummary>& changes);
/// Everything of one change.
std::string FormatChange(const ChangeSummary& change);

/// The box's pose in the map and its size, as fields of the object that is open.
void AppendBoxFields(const OrientedBox& box_map, JsonWriter& json);
/// Everything of a change but its boxes, as fields of the object that is open.
void AppendChangeFields(const ChangeSummary& change, JsonWriter& json);
/// Everything of a change, as a value.
void AppendChange(const ChangeSummary& change, JsonWriter& json);
/// `changes` and an array of them.
void AppendChanges(const std::vector<ChangeSummary>& changes, JsonWriter& json);

}  // namespace mapp
