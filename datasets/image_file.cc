#include "datasets/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string_view>
#include <vector>

namespace mapp {
namespace {

constexpr int kJpegQuality = 95;
constexpr double kMaxDepthValue = 65535.0;

StatusOr<std::vector<uint8_t>> ReadBytes(const std::string& file) {
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return absl::NotFoundError(fmt::format("{}: no such file", file));
  std::ifstream stream(file, std::ios::binary);
  std::vector<uint8_t> bytes{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (!stream || stream.bad()) return absl::DataLossError(fmt::format("{}: cannot be read", file));
  return bytes;
}

bool StartsWith(std::span<const uint8_t> bytes, std::string_view magic) {
  return bytes.size() >= magic.size() && std::equal(magic.begin(), magic.end(), bytes.begin(),
                                                    [](char a, uint8_t b) { return static_cast<uint8_t>(a) == b; });
}

/// Decoders fill the missing part of a file that was cut short with gray and only print a warning, so the end mark is
/// looked for first. Some cameras pad with zeros.
Status CheckComplete(const std::string& file, std::span<const uint8_t> bytes) {
  using namespace std::string_view_literals;
  std::string_view end_mark;
  if (StartsWith(bytes, "\x89PNG\r\n\x1a\n"sv)) {
    end_mark = "IEND\xae\x42\x60\x82"sv;  // the last chunk's name and checksum
  } else if (StartsWith(bytes, "\xff\xd8\xff"sv)) {
    end_mark = "\xff\xd9"sv;
  } else {
    return absl::DataLossError(fmt::format("{}: neither a PNG nor a JPEG file", file));
  }
  while (!bytes.empty() && bytes.back() == 0) bytes = bytes.first(bytes.size() - 1);
  if (bytes.size() < end_mark.size() || !StartsWith(bytes.last(end_mark.size()), end_mark)) {
    return absl::DataLossError(fmt::format("{}: image file is cut short ({} bytes)", file, bytes.size()));
  }
  return absl::OkStatus();
}

StatusOr<cv::Mat> Decode(const std::string& file, int flags) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<uint8_t> bytes, ReadBytes(file));
  MAPP_RETURN_IF_ERROR(CheckComplete(file, bytes));
  cv::Mat decoded;
  try {
    decoded = cv::imdecode(bytes, flags);
  } catch (const cv::Exception& exception) {
    return absl::DataLossError(fmt::format("{}: image does not decode: {}", file, exception.err));
  }
  if (decoded.empty()) return absl::DataLossError(fmt::format("{}: image does not decode", file));
  return decoded;
}

Status Encode(const std::string& file, const cv::Mat& image, const std::vector<int>& params) {
  try {
    if (cv::imwrite(file, image, params)) return absl::OkStatus();
  } catch (const cv::Exception& exception) {
    return absl::ResourceExhaustedError(fmt::format("{}: image cannot be written: {}", file, exception.err));
  }
  return absl::ResourceExhaustedError(fmt::format("{}: image cannot be written", file));
}

}  // namespace

StatusOr<GrayImage> ReadGrayImage(const std::string& file) {
  // A rotated image would no longer fit its calibration.
  MAPP_ASSIGN_OR_RETURN(const cv::Mat decoded, Decode(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION));
  GrayImage gray(decoded.cols, decoded.rows);
  for (int y = 0; y < decoded.rows; ++y) std::copy_n(decoded.ptr<uint8_t>(y), decoded.cols, &gray.at(0, y));
  return gray;
}

StatusOr<DepthImage> ReadDepthImage(const std::string& file, double units_per_metre) {
  MAPP_ASSIGN_OR_RETURN(const cv::Mat decoded, Decode(file, cv::IMREAD_UNCHANGED));
  if (decoded.type() != CV_16UC1) {
    return absl::DataLossError(fmt::format("{}: a depth image must have one channel of 16 bits", file));
  }
  DepthImage depth_m(decoded.cols, decoded.rows);
  const auto metres_per_unit = static_cast<float>(1.0 / units_per_metre);
  for (int y = 0; y < decoded.rows; ++y) {
    const auto* row = decoded.ptr<uint16_t>(y);
    std::transform(row, row + decoded.cols, &depth_m.at(0, y),
                   [=](uint16_t value) { return static_cast<float>(value) * metres_per_unit; });
  }
  return depth_m;
}

Status WriteGrayImage(const std::string& file, const GrayImage& image) {
  cv::Mat mat(image.height, image.width, CV_8UC1);
  std::copy(image.pixels.begin(), image.pixels.end(), mat.ptr<uint8_t>());
  return Encode(file, mat, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
}

Status WriteColorImage(const std::string& file, const Image<std::array<uint8_t, 3>>& image) {
  cv::Mat mat(image.height, image.width, CV_8UC3);
  std::transform(image.pixels.begin(), image.pixels.end(), mat.ptr<cv::Vec3b>(), [](const auto& rgb) {
    return cv::Vec3b(rgb[2], rgb[1], rgb[0]);  // OpenCV keeps blue first
  });
  return Encode(file, mat, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
}

Status WriteDepthImage(const std::string& file, const DepthImage& depth_m, double units_per_metre) {
  cv::Mat mat(depth_m.height, depth_m.width, CV_16UC1);
  std::transform(depth_m.pixels.begin(), depth_m.pixels.end(), mat.ptr<uint16_t>(), [=](float depth) {
    const double value = std::round(static_cast<double>(depth) * units_per_metre);
    return static_cast<uint16_t>(value >= 0 && value <= kMaxDepthValue ? value : 0.0);
  });
  return Encode(file, mat, {});
}

}  // namespace mapp
