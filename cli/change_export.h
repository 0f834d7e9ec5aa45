#pragma once

#include "cli/changed_map.h"
#include "mapp/base/status.h"

#include <string>
#include <vector>

namespace mapp {

enum class ChangeExportFormat { kJson, kPly };

/// By the file's suffix: `.json` and `.geojson`, or `.ply`. INVALID_ARGUMENT: another one.
StatusOr<ChangeExportFormat> ChangeExportFormatOf(const std::string& file);
/// INVALID_ARGUMENT: the file's suffix is not `.png`; `-`, standard output, has none.
Status CheckPngName(const std::string& file);

/// docs/formats/changes.md. The map's frames tell which way is up.
std::string FormatChangeFeatures(const MapContent& map, const std::vector<ChangeSummary>& changes);
/// All points of the map, and those that acceptance of the changes retired, with the colors of the pictures: binary
/// PLY.
std::string FormatChangedPly(const ChangedMap& map);

}  // namespace mapp
