#pragma once

#include "cli/change_info.h"
#include "cli/map_image.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <optional>
#include <ostream>
#include <stop_token>
#include <string>
#include <vector>

namespace mapp {

struct ChangesDetectOptions {
  std::string server;
  ChangeDetectionOrder order;
  bool json = false;
};
/// `mapp changes detect`. CANCELLED on a stop request: what was done by then is kept. NOT_FOUND: no such map, here and
/// below.
Status RunChangesDetect(const ChangesDetectOptions& options, const std::stop_token& stop, std::ostream& out);

struct ChangesListOptions {
  std::string server;
  std::string map_name;
  std::optional<ChangeStatus> status;  ///< only these
  std::optional<ChangeKind> kind;      ///< only these
  bool json = false;
};
/// `mapp changes list`
Status RunChangesList(const ChangesListOptions& options, std::ostream& out);

struct ChangesShowOptions {
  std::string server;
  std::string map_name;
  uint64_t id = 0;
  bool json = false;
};
/// `mapp changes show`. NOT_FOUND: no such change.
Status RunChangesShow(const ChangesShowOptions& options, std::ostream& out);

struct ChangesRenderOptions {
  std::string server;
  std::string map_name;
  std::string out_file;               ///< PNG
  std::optional<uint64_t> change_id;  ///< only this one, before and after
  bool before_after = false;          ///< of all that are not rejected
  MapImageOptions image;
  bool json = false;
};
/// `mapp changes render`. INVALID_ARGUMENT: the file's name is no PNG's. NOT_FOUND: no such change.
Status RunChangesRender(const ChangesRenderOptions& options, std::ostream& out);

struct ChangesExportOptions {
  std::string server;
  std::string map_name;
  std::string out_file;  ///< `.json`, `.geojson` or `.ply`
  bool json = false;
};
/// `mapp changes export`. INVALID_ARGUMENT: the file's suffix is another one.
Status RunChangesExport(const ChangesExportOptions& options, std::ostream& out);

enum class ChangeDecision { kAccept, kReject, kUndo };

struct ChangesDecideOptions {
  std::string server;
  std::string map_name;
  std::vector<uint64_t> ids;
  ChangeDecision decision = ChangeDecision::kAccept;
  bool json = false;
};
/// `mapp changes accept`, `reject` and `undo`: all of the changes or none. NOT_FOUND: no such change.
/// FAILED_PRECONDITION: decided otherwise before. OUT_OF_RANGE: the map's past before an acceptance is compacted away.
Status RunChangesDecide(const ChangesDecideOptions& options, std::ostream& out);

}  // namespace mapp
