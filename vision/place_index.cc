#include "vision/place_index.h"

#include "mapp/base/rng.h"

#include <absl/container/flat_hash_map.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp {
namespace {

constexpr int kDescriptorBits = 8 * OrbDescriptor::kBytes;
constexpr uint32_t kPositionMask = (uint32_t{1} << PlaceBlock::kPositionBits) - 1;

using Entries = std::vector<uint32_t>;

/// Distinct bits, drawn without replacement by a partial Fisher-Yates shuffle.
std::vector<uint8_t> DrawBits(int count, Rng& rng) {
  std::vector<uint8_t> bits(kDescriptorBits);
  for (size_t i = 0; i < bits.size(); ++i) bits[i] = static_cast<uint8_t>(i);
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) std::swap(bits[i], bits[i + rng.Below(bits.size() - i)]);
  bits.resize(static_cast<size_t>(count));
  return bits;
}

/// The bits of a descriptor that make its key.
struct KeyFunction {
  std::vector<uint8_t> bits;

  /// Left of the bits of a position.
  uint32_t operator()(const OrbDescriptor& descriptor) const {
    uint32_t key = 0;
    for (const uint8_t bit : bits) {
      key = (key << 1) | static_cast<uint32_t>((descriptor.words[bit / 64] >> (bit % 64)) & 1);
    }
    return key << PlaceBlock::kPositionBits;
  }
};

void MergeInto(Entries& entries, const Entries& more) {
  Entries merged(entries.size() + more.size());  // and no larger: entries are most of what an index holds
  std::ranges::merge(entries, more, merged.begin());
  entries = std::move(merged);
}

/// A run of frames. Frames that were removed or replaced keep their entries until the sweep.
struct Segment {
  PlaceBlock block;
  std::vector<bool> removed;  ///< per frame

  explicit Segment(const PlaceWords& words) {
    block.words = words;
    block.tables.resize(static_cast<size_t>(words.num_tables));
  }
  size_t size() const { return block.frames.size(); }
};

/// The frames of `segment` that are to be kept, by themselves.
PlaceBlock KeptOf(const PlaceBlock& block, const std::vector<bool>& removed) {
  PlaceBlock kept{.words = block.words, .frames = {}, .tables = {}};
  std::vector<uint32_t> positions(block.frames.size(), 0);
  for (size_t i = 0; i < block.frames.size(); ++i) {
    positions[i] = static_cast<uint32_t>(kept.frames.size());
    if (!removed[i]) kept.frames.push_back(block.frames[i]);
  }
  for (const Entries& entries : block.tables) {
    Entries of_kept;
    for (const uint32_t entry : entries) {
      const uint32_t position = entry & kPositionMask;
      if (!removed[position]) of_kept.push_back((entry & ~kPositionMask) | positions[position]);
    }
    of_kept.shrink_to_fit();
    kept.tables.push_back(std::move(of_kept));
  }
  return kept;
}

}  // namespace

struct PlaceIndex::Impl {
  struct Location {
    Segment* segment = nullptr;
    size_t position = 0;
  };

  explicit Impl(const Options& opts) : options(opts), fresh(opts.words) {}

  /// Appends the block's frames to the last sealed segment, or to another one when that has no room for them.
  void AppendSealed(PlaceBlock block);
  /// Drops the removed frames' entries.
  void Sweep();
  std::vector<float> Vote(std::span<const OrbDescriptor> descriptors) const;
  /// All segments, the fresh one last.
  template <typename Visit>
  void ForEachSegment(const Visit& visit) {
    for (const std::unique_ptr<Segment>& segment : sealed) visit(*segment);
    visit(fresh);
  }
  std::vector<const Segment*> Segments() const {
    std::vector<const Segment*> segments;
    for (const std::unique_ptr<Segment>& segment : sealed) segments.push_back(segment.get());
    segments.push_back(&fresh);
    return segments;
  }

  Options options;
  std::vector<KeyFunction> keys;  ///< per table
  std::vector<std::unique_ptr<Segment>> sealed;
  Segment fresh;  ///< frames added since the last seal
  absl::flat_hash_map<uint64_t, Location> locations;
};

void PlaceIndex::Impl::AppendSealed(PlaceBlock block) {
  if (block.frames.empty()) return;
  if (sealed.empty() || sealed.back()->size() + block.frames.size() > PlaceBlock::kMaxFrames) {
    sealed.push_back(std::make_unique<Segment>(options.words));
  }
  Segment& into = *sealed.back();
  const auto offset = static_cast<uint32_t>(into.size());
  for (const PlaceBlock::Frame& frame : block.frames) {
    locations[frame.id] = {&into, into.size()};
    into.block.frames.push_back(frame);
    into.removed.push_back(false);
  }
  for (size_t t = 0; t < block.tables.size(); ++t) {
    for (uint32_t& entry : block.tables[t]) entry += offset;
    MergeInto(into.block.tables[t], block.tables[t]);
  }
}

void PlaceIndex::Impl::Sweep() {
  ForEachSegment([this](Segment& segment) {
    segment.block = KeptOf(segment.block, segment.removed);
    segment.removed.assign(segment.size(), false);
    for (size_t i = 0; i < segment.size(); ++i) locations[segment.block.frames[i].id] = {&segment, i};
  });
}

/// Sum of key weights per frame, segment after segment.
std::vector<float> PlaceIndex::Impl::Vote(std::span<const OrbDescriptor> descriptors) const {
  // Inverse document frequency, ln(N / n), kept positive when a key is in every frame.
  const auto num_frames = static_cast<float>(locations.size());
  const auto max_entries = static_cast<size_t>(options.max_bucket_entries);
  std::vector<float> weights(max_entries + 1);
  for (size_t n = 1; n < weights.size(); ++n) weights[n] = std::log1p(num_frames / static_cast<float>(n));

  const std::vector<const Segment*> segments = Segments();
  std::vector<size_t> offsets;
  size_t num_slots = 0;
  for (const Segment* segment : segments) {
    offsets.push_back(num_slots);
    num_slots += segment->size();
  }
  std::vector<float> votes(num_slots, 0.0F);
  std::vector<std::span<const uint32_t>> found(segments.size());
  for (size_t t = 0; t < keys.size(); ++t) {
    for (const OrbDescriptor& descriptor : descriptors) {
      const uint32_t key = keys[t](descriptor);
      size_t num_entries = 0;
      for (size_t s = 0; s < segments.size(); ++s) {
        const Entries& entries = segments[s]->block.tables[t];
        const auto first = std::lower_bound(entries.begin(), entries.end(), key);
        auto last = first;
        while (last != entries.end() && (*last & ~kPositionMask) == key && num_entries <= max_entries) {
          ++last;
          ++num_entries;
        }
        found[s] = {first, last};
      }
      if (num_entries > max_entries) continue;
      for (size_t s = 0; s < segments.size(); ++s) {
        for (const uint32_t entry : found[s]) votes[offsets[s] + (entry & kPositionMask)] += weights[num_entries];
      }
    }
  }
  return votes;
}

PlaceIndex::PlaceIndex(const Options& options) {
  Options possible = options;
  possible.words.num_tables = std::clamp(options.words.num_tables, 1, 255);
  possible.words.bits_per_key = std::clamp(options.words.bits_per_key, PlaceWords::kMinBits, PlaceWords::kMaxBits);
  possible.max_bucket_entries = std::max(1, options.max_bucket_entries);
  impl_ = std::make_unique<Impl>(possible);
  Rng rng(possible.words.seed);
  for (int i = 0; i < possible.words.num_tables; ++i) {
    impl_->keys.push_back({DrawBits(possible.words.bits_per_key, rng)});
  }
}

PlaceIndex::~PlaceIndex() = default;
PlaceIndex::PlaceIndex(PlaceIndex&&) noexcept = default;
PlaceIndex& PlaceIndex::operator=(PlaceIndex&&) noexcept = default;

void PlaceIndex::Add(uint64_t frame, std::span<const OrbDescriptor> descriptors) {
  Remove(frame);
  if (num_new_frames() == kMaxNewFrames) SealBlock();
  Segment& fresh = impl_->fresh;
  const auto position = static_cast<uint32_t>(fresh.size());
  const size_t num_chosen = std::min(descriptors.size(), impl_->options.max_features);
  for (size_t t = 0; t < impl_->keys.size(); ++t) {
    Entries entries;
    for (size_t i = 0; i < num_chosen; ++i) {
      entries.push_back(impl_->keys[t](descriptors[i * descriptors.size() / num_chosen]) | position);
    }
    std::ranges::sort(entries);
    entries.erase(std::unique(entries.begin(), entries.end()), entries.end());
    MergeInto(fresh.block.tables[t], entries);
  }
  fresh.block.frames.push_back({frame, static_cast<uint32_t>(num_chosen)});
  fresh.removed.push_back(false);
  impl_->locations[frame] = {&fresh, position};
}

void PlaceIndex::Remove(uint64_t frame) {
  const auto found = impl_->locations.find(frame);
  if (found == impl_->locations.end()) return;
  found->second.segment->removed[found->second.position] = true;
  impl_->locations.erase(found);
  size_t num_slots = 0;
  for (const Segment* segment : impl_->Segments()) num_slots += segment->size();
  if (num_slots > 2 * impl_->locations.size()) impl_->Sweep();
}

bool PlaceIndex::Contains(uint64_t frame) const { return impl_->locations.contains(frame); }

std::vector<PlaceIndex::Candidate> PlaceIndex::Query(std::span<const OrbDescriptor> descriptors, size_t max_candidates,
                                                     const Filter& accept) const {
  const std::vector<float> votes = impl_->Vote(descriptors);
  std::vector<Candidate> candidates;
  size_t slot = 0;
  for (const Segment* segment : impl_->Segments()) {
    for (size_t i = 0; i < segment->size(); ++i, ++slot) {
      const PlaceBlock::Frame& frame = segment->block.frames[i];
      if (votes[slot] <= 0 || segment->removed[i] || (accept && !accept(frame.id))) continue;
      candidates.push_back({frame.id, votes[slot] / std::sqrt(static_cast<double>(frame.num_features))});
    }
  }
  const size_t num_kept = std::min(max_candidates, candidates.size());
  std::partial_sort(candidates.begin(), candidates.begin() + static_cast<ptrdiff_t>(num_kept), candidates.end(),
                    [](const Candidate& a, const Candidate& b) {
                      return a.score != b.score ? a.score > b.score : a.frame < b.frame;
                    });
  candidates.resize(num_kept);
  return candidates;
}

size_t PlaceIndex::num_frames() const { return impl_->locations.size(); }

size_t PlaceIndex::num_new_frames() const { return impl_->fresh.size(); }

PlaceBlock PlaceIndex::SealBlock() {
  PlaceBlock block = KeptOf(impl_->fresh.block, impl_->fresh.removed);
  impl_->fresh = Segment(impl_->options.words);
  impl_->AppendSealed(block);
  return block;
}

Status PlaceIndex::AddBlock(const PlaceBlock& block, const Filter& accept) {
  if (block.words != impl_->options.words) return absl::InvalidArgumentError("place block: made of other words");
  std::vector<bool> left_out;
  for (const PlaceBlock::Frame& frame : block.frames) {
    left_out.push_back(Contains(frame.id) || (accept && !accept(frame.id)));
  }
  impl_->AppendSealed(KeptOf(block, left_out));
  return absl::OkStatus();
}

}  // namespace mapp
