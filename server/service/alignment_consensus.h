#pragma once

#include "server/service/alignment_verifier.h"

#include <map>
#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// Gathers what the keyframes of one fragment say about S_map_session, and tells when enough of them agree (DESIGN 7:
/// a wrong merge is worse than a late one).
class AlignmentConsensus {
 public:
  explicit AlignmentConsensus(const RegistrarOptions& options) : options_(options) {}

  /// Takes one keyframe's word, replacing what the same keyframe said before. Returns how many keyframes agree with it,
  /// itself included.
  int Add(KeyframeAlignment alignment);

  /// S_map_session, once enough keyframes taken from different poses agree on it and they are most of those that said
  /// anything. Its scale is 1 where the keyframes' depths have the map's unit; else they have to have come far enough
  /// to tell it.
  std::optional<Sim3> Decide() const;

  /// Keyframes that have said anything.
  size_t size() const { return alignments_.size(); }

  /// Forgets what was said, once it has turned out wrong: it must not outvote those who come to a true place later.
  void Forget() { alignments_.clear(); }

 private:
  bool Agree(const KeyframeAlignment& a, const KeyframeAlignment& b) const;
  std::vector<const KeyframeAlignment*> AgreeingWith(const KeyframeAlignment& alignment) const;
  bool Suffices(std::span<const KeyframeAlignment* const> agreeing) const;

  RegistrarOptions options_;
  std::map<uint32_t, KeyframeAlignment> alignments_;  ///< by keyframe number
};

/// Whether the keyframe's word is that of a session at `S_map_session`.
bool AgreesWith(const KeyframeAlignment& alignment, const Sim3& S_map_session, const RegistrarOptions& options);

struct FusedAlignment {
  Sim3 S_map_session;
  double scale_sigma = 0;  ///< of the scale's logarithm; 0 when the keyframes' depths have the map's unit
};

/// The S_map_session that best explains all alignments: each keyframe's T_map_camera weighs by its information, limited
/// by what the session's own odometry may have drifted between them. Where the depths have a unit of their own, the way
/// between the keyframes tells the scale, and the depths do as far as such are right: they are all off alike.
FusedAlignment FuseAlignments(std::span<const KeyframeAlignment* const> alignments);

}  // namespace mapp
