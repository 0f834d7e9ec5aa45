#pragma once

#include "mapp/image/image.h"

#include <opencv2/core/mat.hpp>

namespace mapp::internal {

/// A header over the view's pixels: nothing is copied, and OpenCV must only read them.
inline cv::Mat WrapGray(ImageView<uint8_t> image) {
  return cv::Mat(image.height, image.width, CV_8UC1, const_cast<uint8_t*>(image.data), image.stride);
}

}  // namespace mapp::internal
