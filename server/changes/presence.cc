#include "server/changes/presence.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mapp {
namespace {

constexpr double kNsPerDay = 86400e9;
using Belief = std::array<double, 2>;  // gone, there

double SwitchProbability(int64_t elapsed_ns, const PresenceOptions& options) {
  const double days = static_cast<double>(std::max<int64_t>(elapsed_ns, 0)) / kNsPerDay;
  // Two states with equal mean times: the chance of an odd number of switches.
  const double elapsed = 0.5 * (1 - std::exp(-2 * days / options.mean_stay_days));
  return std::clamp(elapsed, options.min_switch, 0.5);
}

/// P(evidence | state), scaled so that the greater is 1.
Belief Likelihood(const PresenceEvidence& evidence, const PresenceOptions& options) {
  const double ratio = PresenceLogRatio(evidence, options);
  return ratio > 0 ? Belief{std::exp(-ratio), 1} : Belief{1, std::exp(ratio)};
}

Belief Normalized(const Belief& belief) {
  const double sum = belief[0] + belief[1];
  return {belief[0] / sum, belief[1] / sum};
}

double LnBeta(double a, double b) { return std::lgamma(a) + std::lgamma(b) - std::lgamma(a + b); }

/// ln of the probability of one course of `hits` and `others` whose rate is of Beta(a, b).
double LnBetaBinomial(double hits, double others, double a, double b) {
  return LnBeta(hits + a, others + b) - LnBeta(a, b);
}

}  // namespace

double PresenceLogRatio(const PresenceEvidence& evidence, const PresenceOptions& options) {
  const double num = evidence.num_seen + evidence.num_missed;
  if (num == 0) return 0;
  const double independent = std::min(options.max_independent_points, options.independent_share * num);
  const double num_missed = independent * evidence.num_missed / num, num_seen = independent - num_missed;
  const double weight = options.rate_weight;
  return LnBetaBinomial(num_missed, num_seen, weight * options.miss_if_present,
                        weight * (1 - options.miss_if_present)) -
         LnBetaBinomial(num_missed, num_seen, weight * (1 - options.see_if_absent), weight * options.see_if_absent);
}

PresencePosterior InferPresence(std::span<const PresenceEvidence> visits, const PresenceOptions& options) {
  const size_t num = visits.size();
  PresencePosterior posterior;
  if (num == 0) return posterior;
  std::vector<Belief> likelihood(num), forward(num), backward(num);
  std::vector<double> switches(num, 0);  // between visit i - 1 and i
  for (size_t i = 0; i < num; ++i) {
    likelihood[i] = Likelihood(visits[i], options);
    if (i > 0) switches[i] = SwitchProbability(visits[i].time_ns - visits[i - 1].time_ns, options);
  }
  std::vector<std::array<uint8_t, 2>> came_from(num);
  Belief best = {std::log(0.5) + std::log(likelihood[0][0]), std::log(0.5) + std::log(likelihood[0][1])};
  forward[0] = Normalized(likelihood[0]);
  for (size_t i = 1; i < num; ++i) {
    const double turn = switches[i];
    Belief predicted, next_best;
    for (size_t to = 0; to < 2; ++to) {
      predicted[to] = forward[i - 1][to] * (1 - turn) + forward[i - 1][1 - to] * turn;
      const double stay = best[to] + std::log(1 - turn), come = best[1 - to] + std::log(turn);
      came_from[i][to] = static_cast<uint8_t>(come > stay ? 1 - to : to);
      next_best[to] = std::max(stay, come) + std::log(likelihood[i][to]);
    }
    best = next_best;
    forward[i] = Normalized({predicted[0] * likelihood[i][0], predicted[1] * likelihood[i][1]});
  }
  backward[num - 1] = {1, 1};
  for (size_t i = num - 1; i > 0; --i) {
    const double turn = switches[i];
    Belief belief;
    for (size_t from = 0; from < 2; ++from) {
      belief[from] =
          (1 - turn) * likelihood[i][from] * backward[i][from] + turn * likelihood[i][1 - from] * backward[i][1 - from];
    }
    backward[i - 1] = Normalized(belief);
  }
  posterior.present.resize(num);
  posterior.likely.resize(num);
  for (size_t i = 0; i < num; ++i) {
    posterior.present[i] = Normalized({forward[i][0] * backward[i][0], forward[i][1] * backward[i][1]})[1];
  }
  for (size_t i = 0; i + 1 < num; ++i) {
    const double turn = switches[i + 1];
    double sum = 0;
    std::array<Belief, 2> joint;
    for (size_t from = 0; from < 2; ++from) {
      for (size_t to = 0; to < 2; ++to) {
        joint[from][to] =
            forward[i][from] * (from == to ? 1 - turn : turn) * likelihood[i + 1][to] * backward[i + 1][to];
        sum += joint[from][to];
      }
    }
    posterior.vanished.push_back(joint[1][0] / sum);
    posterior.appeared.push_back(joint[0][1] / sum);
  }
  size_t state = best[1] >= best[0] ? 1 : 0;
  for (size_t i = num; i-- > 0;) {
    posterior.likely[i] = state == 1;
    if (i > 0) state = came_from[i][state];
  }
  return posterior;
}

}  // namespace mapp
