#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "mapp/feature/feature.h"

namespace mapp {

/// Incremental index from binary descriptors to the frames that hold them: locality-sensitive hashing on sampled bits
/// (Indyk and Motwani 1998), votes weighted by how rare a bucket is. Adding and asking cost the same whatever the
/// index holds, up to the bucket cap. Thread-compatible: guard it outside.
class PlaceIndex {
 public:
  struct Options {
    int num_tables = 8;
    int bits_per_key = 20;
    /// Buckets beyond this many entries are too common to tell places apart: they stop counting.
    int max_bucket_entries = 200;
    uint64_t seed = 7;
  };
  struct Candidate {
    uint64_t frame = 0;
    double score = 0;  ///< sum of bucket weights over the square root of the frame's feature count
  };

  explicit PlaceIndex(const Options& options);

  /// `frame` is the caller's key; adding it again adds to it.
  void Add(uint64_t frame, std::span<const OrbDescriptor> descriptors);
  void Remove(uint64_t frame);
  /// Best `max_candidates` frames by score, best first, of those for which `accept` (if any) is not cleared.
  std::vector<Candidate> Query(std::span<const OrbDescriptor> descriptors, size_t max_candidates) const;
  size_t num_frames() const { return feature_counts_.size(); }

 private:
  struct Posting {
    uint32_t frame_slot;
  };
  Options options_;
  std::vector<std::vector<uint8_t>> key_bits_;  ///< per table, which bits form the key
  std::vector<std::vector<std::vector<uint32_t>>> tables_;
  std::vector<uint64_t> slot_frames_;
  std::vector<uint32_t> feature_counts_;
};

}  // namespace mapp
