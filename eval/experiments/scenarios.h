#pragma once

#include "eval/experiments/experiment.h"
#include "eval/harness/fleet.h"

#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// The garage, plaza or city at the context's scale. `num_users` of 0: the scale's own number.
sim::SimulationOptions SettingWorld(const EvalContext& context, const std::string& setting, int num_users = 0);
/// The machine hall with the given flights, or with flights of its own.
sim::SimulationOptions HallWorld(const EvalContext& context);

/// "garage, 4 users of 40 m, RGB-D, feature level."
std::string Describe(const FleetSpec& spec);

/// 1000 B = 1 KB, as the paper counts.
std::optional<double> Kilobytes(const std::optional<double>& bytes);
/// What the uncompressed layout of the paper's baseline would have taken for the device's whole keyframes, KB each.
std::optional<double> VanillaKilobytesPerKeyframe(const DeviceFigures& device);
/// part / whole in percent.
std::optional<double> Percent(const std::optional<double>& part, const std::optional<double>& whole);
std::optional<double> Scaled(const std::optional<double>& value, double factor);

}  // namespace mapp
