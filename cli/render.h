#pragma once

#include "cli/map_image.h"
#include "mapp/base/status.h"

#include <ostream>
#include <string>
#include <vector>

namespace mapp {

struct RenderOptions {
  std::string server;
  std::string map_name;
  std::string at;                        ///< revision or tag; empty: now
  std::string out_file;                  ///< PNG
  std::vector<std::string> frame_files;  ///< frame logs of sessions of this map, as `mapp replay` writes them
  MapImageOptions image;
  bool json = false;
};
/// `mapp render`: a picture of the map from above. NOT_FOUND: no such map or frame log.
Status RunRender(const RenderOptions& options, std::ostream& out);

}  // namespace mapp
