#include "eval/harness/point_cloud.h"

#include <fmt/format.h>

#include <fstream>
#include <sstream>

namespace mapp {

StatusOr<std::vector<Eigen::Vector3d>> ReadAsciiPly(const std::string& file) {
  std::ifstream stream(file);
  if (!stream) return absl::NotFoundError(fmt::format("{}: cannot be opened", file));
  const auto broken = [&](int line_number, const char* what) {
    return absl::DataLossError(fmt::format("{}:{}: {}", file, line_number, what));
  };
  size_t num_points = 0;
  int line_number = 0;
  bool is_text = false;
  std::string line;
  while (std::getline(stream, line) && line != "end_header") {
    ++line_number;
    is_text = is_text || line == "format ascii 1.0";
    std::istringstream words(line);
    std::string keyword, element;
    if (words >> keyword >> element && keyword == "element" && element == "vertex") words >> num_points;
  }
  if (!is_text || !stream) return broken(line_number, "the header of an ASCII PLY expected");
  std::vector<Eigen::Vector3d> points;
  points.reserve(num_points);
  for (; points.size() < num_points; ++line_number) {
    Eigen::Vector3d p;
    if (!std::getline(stream, line) || !(std::istringstream(line) >> p.x() >> p.y() >> p.z())) {
      return broken(line_number + 2, "three coordinates expected");
    }
    points.push_back(p);
  }
  return points;
}

}  // namespace mapp
