#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace mapp {

/// What one visit says of a thing: how many of its points were seen, and how many missed where they should have been.
struct PresenceEvidence {
  int64_t time_ns = 0;  ///< Unix time, not decreasing
  double num_seen = 0;
  double num_missed = 0;
};

/// Parameters of the persistence posterior, with their sources.
struct PresenceOptions {
  /// Probability that a point of a thing that is there is judged missed, and that one of a thing that is gone is judged
  /// seen (Rosen et al. 2016, P_M and P_F). Chosen, not measured: looser than what points of simulated garages showed
  /// (a few of a hundred either way), for places where nobody has measured.
  double miss_if_present = 0.1;
  double see_if_absent = 0.15;
  /// These rates differ from thing to thing and from view to view: each is of a beta distribution with this mean, as if
  /// so many points had told of it. Where a visit sees half of a thing, it says next to nothing.
  double rate_weight = 10;
  /// Points of one thing see and miss together: what makes one seen makes its neighbours seen. So many of them at most
  /// count as independent, and a share of them below that.
  double max_independent_points = 16;
  double independent_share = 0.6;
  /// Mean time that a thing stays, and stays away (Perpetua, 2025: two exponential survival times in turn).
  double mean_stay_days = 30;
  /// Least probability of a change between two visits, however soon they follow: a world can change in a minute, and
  /// clocks are no evidence.
  double min_switch = 0.01;
};

/// Probability that a thing was there at each visit, given all visits: a two-state hidden Markov model, forward and
/// backward, whose switching time is exponential (persistence filter of Rosen et al. 2016, which allows one
/// disappearance; here things may come back).
struct PresencePosterior {
  std::vector<double> present;  ///< at each visit
  std::vector<bool> likely;     ///< the most probable course (Viterbi)
  /// Probability of (there, gone) and of (gone, there) at visits i and i + 1.
  std::vector<double> vanished;
  std::vector<double> appeared;
};
PresencePosterior InferPresence(std::span<const PresenceEvidence> visits, const PresenceOptions& options);

/// ln P(evidence | there) - ln P(evidence | gone).
double PresenceLogRatio(const PresenceEvidence& evidence, const PresenceOptions& options);

}  // namespace mapp
