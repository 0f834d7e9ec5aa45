#pragma once

#include "mapp/feature/feature.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

namespace mapp {

/// Incremental index from binary descriptors to the frames that hold them: locality-sensitive hashing on sampled bits
/// (Indyk and Motwani 1998), votes weighted by how rare a bucket is. Adding and asking cost the same whatever the
/// index holds, up to the bucket cap. Thread-compatible: guard it outside.
class PlaceIndex {
 public:
  struct Options {
    int num_tables = 8;
    /// Range [8, 32]. More bits make a collision say more and happen less often.
    int bits_per_key = 20;
    /// Buckets beyond this many entries are too common to tell places apart: they stop counting.
    int max_bucket_entries = 200;
    uint64_t seed = 7;
  };
  struct Candidate {
    uint64_t frame = 0;
    double score = 0;  ///< sum of bucket weights over the square root of the frame's feature count
  };
  /// Whether a frame may be a candidate.
  using Filter = std::function<bool(uint64_t frame)>;

  explicit PlaceIndex(const Options& options);
  ~PlaceIndex();
  PlaceIndex(PlaceIndex&&) noexcept;
  PlaceIndex& operator=(PlaceIndex&&) noexcept;

  /// `frame` is the caller's key; adding it again adds to it.
  void Add(uint64_t frame, std::span<const OrbDescriptor> descriptors);
  /// Forgets the frame; unknown frames are ignored. Its memory is reclaimed once removed frames outnumber the others.
  void Remove(uint64_t frame);
  /// Best `max_candidates` frames by score, best first (by key among equals), of those that `accept`, if any, passes.
  std::vector<Candidate> Query(std::span<const OrbDescriptor> descriptors, size_t max_candidates,
                               const Filter& accept = {}) const;
  size_t num_frames() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
