#pragma once

#include "mapp/base/status.h"
#include "mapp/feature/feature_settings.h"

#include <string>

namespace mapp {

/// 1 to 128 characters of UTF-8, none of them a control character. INVALID_ARGUMENT naming the field.
Status ValidateName(const std::string& name, const std::string& field);

/// Alignment, association and optimisation take octaves for powers of one scale: a map of another would be wrong.
/// INVALID_ARGUMENT naming the setting.
Status CheckScaleIsComputedWith(const FeatureSettings& features);

}  // namespace mapp
