#include "server/changes/thing_memory.h"

#include "mapp/base/bytes.h"

#include <algorithm>

namespace mapp {
namespace {

uint32_t CrcOf(std::span<const WitnessFrame> frames) {
  ByteWriter writer;
  for (const auto& [frame, T_map_camera] : frames) {
    const Eigen::Quaterniond& q = T_map_camera.rotation();
    const Eigen::Vector3d& t = T_map_camera.translation();
    writer.PutVarint(frame.value());
    for (const double value : {t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z()}) writer.Put(value);
  }
  return Crc32c(writer.bytes());
}

}  // namespace

void ThingMemory::Begin(std::span<const SessionFindings> findings) {
  frames_crc_.clear();
  for (const SessionFindings& of_session : findings) {
    frames_crc_.emplace(of_session.session, CrcOf(of_session.frames));
  }
  const MutexLock lock(mutex_);
  for (auto& [key, entry] : entries_) entry.is_used = false;
}

std::optional<ThingVerdict> ThingMemory::Find(const ThingQuestion& question) {
  const MutexLock lock(mutex_);
  const auto found = entries_.find(KeyOf(question));
  if (found == entries_.end()) return std::nullopt;
  const bool stand_still = std::ranges::equal(
      question.p_map, found->second.p_map,
      [](const Eigen::Vector3f& a, const Eigen::Vector3f& b) { return (a - b).squaredNorm() < kStillM * kStillM; });
  if (!stand_still) return std::nullopt;
  found->second.is_used = true;
  return found->second.verdict;
}

void ThingMemory::Keep(const ThingQuestion& question, const ThingVerdict& verdict) {
  const MutexLock lock(mutex_);
  entries_[KeyOf(question)] = {{question.p_map.begin(), question.p_map.end()}, verdict};
}

void ThingMemory::End() {
  const MutexLock lock(mutex_);
  std::erase_if(entries_, [](const auto& entry) { return !entry.second.is_used; });
}

std::string ThingMemory::KeyOf(const ThingQuestion& question) const {
  ByteWriter writer;
  writer.PutVarint(question.event.session.value());
  writer.Put(static_cast<uint8_t>(question.event.came));
  writer.PutVarint(question.ids.size());
  for (const MapPointId id : question.ids) writer.Put(id.value());
  for (const TellingSession& one : question.telling) {
    writer.PutVarint(one.session.value());
    writer.Put(one.opened_ns);
    writer.PutVarint(one.counts.num_seen);
    writer.PutVarint(one.counts.num_missed);
    writer.Put(static_cast<uint8_t>(one.has_views));
    const auto frames = frames_crc_.find(one.session);
    writer.Put(frames == frames_crc_.end() ? uint32_t{0} : frames->second);
  }
  return writer.Take();
}

}  // namespace mapp
