#pragma once

#include "mapp/feature/feature.h"
#include "vision/place_block.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

namespace mapp {

/// Incremental index from binary descriptors to the frames that hold them: locality-sensitive hashing on sampled bits
/// (Indyk and Motwani 1998), votes weighted by how rare a key is. At most 4 bytes a feature and table, 4.8 KB a frame;
/// kept as sorted runs, so that what is known can be stored and read back (place_block.h). Asking takes a search in
/// one run for each 4096 frames. Thread-compatible: guard it outside.
class PlaceIndex {
 public:
  struct Options {
    PlaceWords words = {};
    /// Keys of more frames than this are too common to tell places apart: they do not count.
    int max_bucket_entries = 200;
    /// Of a frame with more, so many are indexed, evenly chosen: more find hardly more frames again
    /// (docs/decisions/0016).
    size_t max_features = 600;
  };
  struct Candidate {
    uint64_t frame = 0;
    double score = 0;  ///< sum of key weights over the square root of the frame's indexed features
  };
  /// Whether a frame may be a candidate.
  using Filter = std::function<bool(uint64_t frame)>;

  explicit PlaceIndex(const Options& options);
  ~PlaceIndex();
  PlaceIndex(PlaceIndex&&) noexcept;
  PlaceIndex& operator=(PlaceIndex&&) noexcept;

  /// `frame` is the caller's key; what was known of it is replaced.
  void Add(uint64_t frame, std::span<const OrbDescriptor> descriptors);
  /// Forgets the frame; unknown frames are ignored. Its memory is reclaimed once removed frames outnumber the others.
  void Remove(uint64_t frame);
  bool Contains(uint64_t frame) const;
  /// Best `max_candidates` frames by score, best first (by key among equals), of those that `accept`, if any, passes.
  std::vector<Candidate> Query(std::span<const OrbDescriptor> descriptors, size_t max_candidates,
                               const Filter& accept = {}) const;
  size_t num_frames() const;
  /// Of one frame, at most.
  static constexpr size_t kBytesAFrame = 4800;

  /// Frames added since the last SealBlock(); from kMaxNewFrames on they are sealed by themselves, and not stored.
  size_t num_new_frames() const;
  static constexpr size_t kMaxNewFrames = 256;
  /// Takes what is known of these frames, to be stored.
  PlaceBlock SealBlock();
  /// Adds the frames of a stored block that `accept` passes and that are not known yet. INVALID_ARGUMENT when it was
  /// made of other words.
  Status AddBlock(const PlaceBlock& block, const Filter& accept);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
