#include "vision/place_index.h"

#include "mapp/base/rng.h"

#include <absl/container/flat_hash_map.h>
#include <absl/container/inlined_vector.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp {
namespace {

constexpr int kDescriptorBits = 8 * OrbDescriptor::kBytes;
constexpr int kMinKeyBits = 8;
constexpr int kMaxKeyBits = 32;

/// Frames holding a descriptor with the bucket's key, each once, by slot. Most buckets are short and stay inline.
struct Bucket {
  absl::InlinedVector<uint32_t, 4> slots;
  bool is_common = false;  ///< reached the cap: emptied for good
};

/// One hash function (a choice of descriptor bits) and its buckets.
struct Table {
  std::vector<uint8_t> key_bits;
  absl::flat_hash_map<uint32_t, Bucket> buckets;

  uint32_t KeyOf(const OrbDescriptor& descriptor) const {
    uint32_t key = 0;
    for (const uint8_t bit : key_bits) {
      key = (key << 1) | static_cast<uint32_t>((descriptor.words[bit / 64] >> (bit % 64)) & 1);
    }
    return key;
  }
};

/// Distinct bits, drawn without replacement by a partial Fisher-Yates shuffle.
std::vector<uint8_t> DrawBits(int count, Rng& rng) {
  std::vector<uint8_t> bits(kDescriptorBits);
  for (size_t i = 0; i < bits.size(); ++i) bits[i] = static_cast<uint8_t>(i);
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) std::swap(bits[i], bits[i + rng.Below(bits.size() - i)]);
  bits.resize(static_cast<size_t>(count));
  return bits;
}

struct Slot {
  uint64_t frame = 0;
  uint32_t num_features = 0;
  bool removed = false;
};

}  // namespace

struct PlaceIndex::Impl {
  Options options;
  std::vector<Table> tables;
  std::vector<Slot> slots;
  absl::flat_hash_map<uint64_t, uint32_t> slot_of_frame;

  void AddToBucket(Bucket& bucket, uint32_t slot) const;
  void DropRemoved();
  std::vector<float> Vote(std::span<const OrbDescriptor> descriptors) const;
};

void PlaceIndex::Impl::AddToBucket(Bucket& bucket, uint32_t slot) const {
  if (bucket.is_common) return;
  // A frame full of one texture must not fill a bucket by itself: its entries are the last ones.
  if (!bucket.slots.empty() && bucket.slots.back() == slot) return;
  bucket.slots.push_back(slot);
  if (bucket.slots.size() > static_cast<size_t>(options.max_bucket_entries)) {
    bucket.slots = {};
    bucket.is_common = true;
  }
}

/// Renumbers the slots in use and sweeps the others from the buckets.
void PlaceIndex::Impl::DropRemoved() {
  std::vector<Slot> kept;
  std::vector<uint32_t> new_slots(slots.size(), 0);
  for (size_t i = 0; i < slots.size(); ++i) {
    if (slots[i].removed) continue;
    new_slots[i] = static_cast<uint32_t>(kept.size());
    slot_of_frame[slots[i].frame] = new_slots[i];
    kept.push_back(slots[i]);
  }
  for (Table& table : tables) {
    absl::erase_if(table.buckets, [&](auto& entry) {
      Bucket& bucket = entry.second;
      const auto end =
          std::remove_if(bucket.slots.begin(), bucket.slots.end(), [&](uint32_t slot) { return slots[slot].removed; });
      bucket.slots.erase(end, bucket.slots.end());
      for (uint32_t& slot : bucket.slots) slot = new_slots[slot];
      return bucket.slots.empty() && !bucket.is_common;
    });
  }
  slots = std::move(kept);
}

/// Sum of bucket weights per slot.
std::vector<float> PlaceIndex::Impl::Vote(std::span<const OrbDescriptor> descriptors) const {
  // Inverse document frequency, ln(N / n), kept positive when a bucket holds every frame.
  const auto num_frames = static_cast<float>(slot_of_frame.size());
  std::vector<float> weights(static_cast<size_t>(options.max_bucket_entries) + 1);
  for (size_t n = 1; n < weights.size(); ++n) weights[n] = std::log1p(num_frames / static_cast<float>(n));

  std::vector<float> votes(slots.size(), 0.0F);
  for (const Table& table : tables) {
    for (const OrbDescriptor& descriptor : descriptors) {
      const auto found = table.buckets.find(table.KeyOf(descriptor));
      if (found == table.buckets.end()) continue;
      const auto& bucket_slots = found->second.slots;
      const float weight = weights[bucket_slots.size()];
      for (const uint32_t slot : bucket_slots) votes[slot] += weight;
    }
  }
  return votes;
}

PlaceIndex::PlaceIndex(const Options& options) : impl_(std::make_unique<Impl>()) {
  impl_->options = options;
  impl_->options.num_tables = std::max(1, options.num_tables);
  impl_->options.bits_per_key = std::clamp(options.bits_per_key, kMinKeyBits, kMaxKeyBits);
  impl_->options.max_bucket_entries = std::max(1, options.max_bucket_entries);
  Rng rng(options.seed);
  for (int i = 0; i < impl_->options.num_tables; ++i) {
    impl_->tables.push_back({.key_bits = DrawBits(impl_->options.bits_per_key, rng), .buckets = {}});
  }
}

PlaceIndex::~PlaceIndex() = default;
PlaceIndex::PlaceIndex(PlaceIndex&&) noexcept = default;
PlaceIndex& PlaceIndex::operator=(PlaceIndex&&) noexcept = default;

void PlaceIndex::Add(uint64_t frame, std::span<const OrbDescriptor> descriptors) {
  const auto [entry, is_new] = impl_->slot_of_frame.try_emplace(frame, static_cast<uint32_t>(impl_->slots.size()));
  if (is_new) impl_->slots.push_back({.frame = frame});
  const uint32_t slot = entry->second;
  impl_->slots[slot].num_features += static_cast<uint32_t>(descriptors.size());
  for (Table& table : impl_->tables) {
    for (const OrbDescriptor& descriptor : descriptors) {
      impl_->AddToBucket(table.buckets[table.KeyOf(descriptor)], slot);
    }
  }
}

void PlaceIndex::Remove(uint64_t frame) {
  const auto found = impl_->slot_of_frame.find(frame);
  if (found == impl_->slot_of_frame.end()) return;
  impl_->slots[found->second].removed = true;
  impl_->slot_of_frame.erase(found);
  const size_t num_removed = impl_->slots.size() - impl_->slot_of_frame.size();
  if (num_removed > impl_->slot_of_frame.size()) impl_->DropRemoved();
}

std::vector<PlaceIndex::Candidate> PlaceIndex::Query(std::span<const OrbDescriptor> descriptors, size_t max_candidates,
                                                     const Filter& accept) const {
  const std::vector<float> votes = impl_->Vote(descriptors);
  std::vector<Candidate> candidates;
  for (size_t i = 0; i < votes.size(); ++i) {
    const Slot& slot = impl_->slots[i];
    if (votes[i] <= 0 || slot.removed || (accept && !accept(slot.frame))) continue;
    candidates.push_back({slot.frame, votes[i] / std::sqrt(static_cast<double>(slot.num_features))});
  }
  const size_t num_kept = std::min(max_candidates, candidates.size());
  std::partial_sort(candidates.begin(), candidates.begin() + static_cast<ptrdiff_t>(num_kept), candidates.end(),
                    [](const Candidate& a, const Candidate& b) {
                      return a.score != b.score ? a.score > b.score : a.frame < b.frame;
                    });
  candidates.resize(num_kept);
  return candidates;
}

size_t PlaceIndex::num_frames() const { return impl_->slot_of_frame.size(); }

}  // namespace mapp
