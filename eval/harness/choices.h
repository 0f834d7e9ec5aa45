#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/client/participant.h"
#include "sim/world/world.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>

namespace mapp {

/// A value that people name on the command line and read in reports.
template <typename T>
struct Choice {
  const char* name;
  T value;
};

inline constexpr std::array kPolicyChoices = {Choice<UploadPolicy>{"map", UploadPolicy::kMap},
                                              Choice<UploadPolicy>{"upload_all", UploadPolicy::kUploadAll}};
inline constexpr std::array kSamplerChoices = {Choice<SamplerKind>{"depth_sketch", SamplerKind::kDepthSketch},
                                               Choice<SamplerKind>{"uniform", SamplerKind::kUniform},
                                               Choice<SamplerKind>{"occupancy", SamplerKind::kOccupancy}};
inline constexpr std::array kInjectionChoices = {Choice<Injection>{"often", Injection::kOften},
                                                 Choice<Injection>{"random", Injection::kRandom},
                                                 Choice<Injection>{"none", Injection::kNone}};
inline constexpr std::array kSensorChoices = {
    Choice<SensorKind>{"rgbd", SensorKind::kRgbd}, Choice<SensorKind>{"stereo", SensorKind::kStereo},
    Choice<SensorKind>{"mono", SensorKind::kMono}, Choice<SensorKind>{"mono-inertial", SensorKind::kMonoInertial}};
inline constexpr std::array kChangeKindChoices = {Choice<sim::ChangeKind>{"appeared", sim::ChangeKind::kAppeared},
                                                  Choice<sim::ChangeKind>{"vanished", sim::ChangeKind::kVanished},
                                                  Choice<sim::ChangeKind>{"moved", sim::ChangeKind::kMoved}};
inline constexpr std::array kSwitchChoices = {Choice<bool>{"on", true}, Choice<bool>{"off", false}};

/// The name of a value that is among the choices.
template <typename T, size_t N>
std::string NameOf(const std::array<Choice<T>, N>& choices, T value) {
  const auto found = std::ranges::find(choices, value, &Choice<T>::value);
  return found == choices.end() ? "unknown" : found->name;
}

template <typename T, size_t N>
std::optional<T> ValueOf(const std::array<Choice<T>, N>& choices, const std::string& name) {
  const auto found = std::ranges::find_if(choices, [&](const Choice<T>& choice) { return name == choice.name; });
  if (found == choices.end()) return std::nullopt;
  return found->value;
}

/// "one of a, b, c"
template <typename T, size_t N>
std::string OneOf(const std::array<Choice<T>, N>& choices) {
  std::string text = "one of ";
  for (size_t i = 0; i < N; ++i) text += std::string(i == 0 ? "" : ", ") + choices[i].name;
  return text;
}

}  // namespace mapp
