#pragma once

#include "mapp/base/status.h"
#include "mapp/image/image.h"

#include <array>
#include <cstdint>
#include <string>

namespace mapp {

/// Reads a PNG or JPEG file as gray levels (colour is converted).
/// NOT_FOUND: no such file. DATA_LOSS: cut short, or it does not decode.
/// Damaged bytes in the middle of a JPEG are not noticed: the format has no checksum.
StatusOr<GrayImage> ReadGrayImage(const std::string& file);

/// Reads a 16-bit PNG; metres = value / `units_per_metre`, 0 stays 0. Errors as above; DATA_LOSS for another format.
StatusOr<DepthImage> ReadDepthImage(const std::string& file, double units_per_metre);

/// Writes by the name's ending: .png, or .jpg with quality 95. RESOURCE_EXHAUSTED when it cannot be written.
Status WriteGrayImage(const std::string& file, const GrayImage& image);
/// The same for red, green and blue.
Status WriteColorImage(const std::string& file, const Image<std::array<uint8_t, 3>>& image);
/// Writes a 16-bit PNG, value = round(metres * `units_per_metre`), 0 where that does not fit in 16 bits.
Status WriteDepthImage(const std::string& file, const DepthImage& depth_m, double units_per_metre);

}  // namespace mapp
