#include "server/service/loaded_tile.h"

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

/// A segment joins the one before it when that one is less than this many times its size.
constexpr size_t kMergeRatio = 8;

LoadedPoint Load(const PointRecord& record, const std::vector<ObserverFrame>& frames,
                 const std::unordered_map<FrameId, uint32_t>& frame_index) {
  LoadedPoint point;
  point.id = record.id;
  point.p_map = record.position.cast<float>();
  point.view_direction = record.view_direction;
  point.descriptor = record.descriptor;
  point.reference_distance_m = record.reference_distance_m;
  point.confidence = record.confidence;
  point.num_observations = record.num_observations;
  for (const FrameId observer : record.observers) {
    const auto found = frame_index.find(observer);
    if (found == frame_index.end() || point.num_observers == TilePoint::kMaxObservers) continue;
    const Eigen::Vector3d from_center = record.position - frames[found->second].T_map_camera.translation();
    point.observer_frames[point.num_observers] = found->second;
    point.observer_directions[point.num_observers] = from_center.normalized().cast<float>();
    ++point.num_observers;
  }
  return point;
}

bool ById(const LoadedPoint& a, const LoadedPoint& b) { return a.id < b.id; }

}  // namespace

StatusOr<LoadedTile::Part> LoadedTile::BuildPart(std::vector<LoadedPoint> points) {
  std::sort(points.begin(), points.end(), ById);
  std::vector<Eigen::Vector3f> positions;
  positions.reserve(points.size());
  for (const LoadedPoint& point : points) positions.push_back(point.p_map);
  MAPP_ASSIGN_OR_RETURN(PointTree tree, PointTree::Build(positions));
  Segment segment{std::move(points), std::move(tree)};
  return Part{std::make_shared<const Segment>(std::move(segment)), nullptr, 0};
}

std::shared_ptr<const LoadedTile::Frames> LoadedTile::MergeFrames(std::shared_ptr<const Frames> present,
                                                                  std::span<const ObserverFrame> added) {
  if (present != nullptr && added.empty()) return present;
  auto merged = present == nullptr ? std::make_shared<Frames>() : std::make_shared<Frames>(*present);
  for (const ObserverFrame& frame : added) {
    const auto [entry, is_new] = merged->index.try_emplace(frame.id, static_cast<uint32_t>(merged->list.size()));
    if (is_new) {
      merged->list.push_back(frame);
    } else {
      merged->list[entry->second] = frame;
    }
  }
  return merged;
}

void LoadedTile::Hide(std::vector<Part>& parts, std::span<const MapPointId> sorted_ids) {
  for (Part& part : parts) {
    const std::vector<LoadedPoint>& points = part.segment->points;
    std::shared_ptr<std::vector<bool>> hidden;
    auto from = points.begin();
    for (const MapPointId id : sorted_ids) {
      from =
          std::lower_bound(from, points.end(), id, [](const LoadedPoint& p, MapPointId value) { return p.id < value; });
      if (from == points.end()) break;
      const auto i = static_cast<size_t>(from - points.begin());
      if (from->id != id || part.IsHidden(i)) continue;
      if (hidden == nullptr) {
        hidden = part.hidden == nullptr ? std::make_shared<std::vector<bool>>(points.size(), false)
                                        : std::make_shared<std::vector<bool>>(*part.hidden);
      }
      (*hidden)[i] = true;
      ++part.num_hidden;
    }
    if (hidden != nullptr) part.hidden = std::move(hidden);
  }
}

Status LoadedTile::Compact(std::vector<Part>& parts) {
  std::erase_if(parts, [](const Part& part) { return part.num_live() == 0; });
  // From the newest back: what is merged is always a suffix, except a segment that is half hidden.
  for (size_t i = parts.size(); i-- > 0;) {
    const bool join_next = i + 1 < parts.size() && parts[i + 1].num_live() * kMergeRatio > parts[i].num_live();
    const bool half_hidden = parts[i].num_hidden * 2 > parts[i].segment->points.size();
    if (!join_next && !half_hidden) continue;
    const size_t end = join_next ? i + 2 : i + 1;
    std::vector<LoadedPoint> points;
    for (size_t k = i; k < end; ++k) {
      for (size_t j = 0; j < parts[k].segment->points.size(); ++j) {
        if (!parts[k].IsHidden(j)) points.push_back(parts[k].segment->points[j]);
      }
    }
    MAPP_ASSIGN_OR_RETURN(parts[i], BuildPart(std::move(points)));
    parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(i + 1), parts.begin() + static_cast<std::ptrdiff_t>(end));
  }
  return absl::OkStatus();
}

StatusOr<std::shared_ptr<const LoadedTile>> LoadedTile::Assemble(const TileKey& key, Revision revision,
                                                                 std::vector<Part> parts,
                                                                 std::shared_ptr<const Frames> frames) {
  MAPP_RETURN_IF_ERROR(Compact(parts));
  if (parts.empty()) return std::shared_ptr<const LoadedTile>();
  auto tile = std::make_shared<LoadedTile>();
  tile->key_ = key;
  tile->revision_ = revision;
  tile->frames_ = std::move(frames);
  tile->bytes_ = sizeof(LoadedTile) + tile->frames_->list.size() * (sizeof(ObserverFrame) + 48);
  for (const Part& part : parts) {
    tile->num_points_ += part.num_live();
    tile->bytes_ += part.segment->points.size() * sizeof(LoadedPoint) + part.segment->tree.bytes();
  }
  tile->parts_ = std::move(parts);
  return std::shared_ptr<const LoadedTile>(std::move(tile));
}

StatusOr<std::shared_ptr<const LoadedTile>> LoadedTile::Create(const TileKey& key, Revision revision,
                                                               std::span<const PointRecord> points,
                                                               std::span<const ObserverFrame> frames) {
  if (points.empty()) return std::shared_ptr<const LoadedTile>();
  std::shared_ptr<const Frames> loaded_frames = MergeFrames(nullptr, frames);
  std::vector<LoadedPoint> loaded;
  loaded.reserve(points.size());
  for (const PointRecord& point : points) loaded.push_back(Load(point, loaded_frames->list, loaded_frames->index));
  MAPP_ASSIGN_OR_RETURN(Part part, BuildPart(std::move(loaded)));
  std::vector<Part> parts = {std::move(part)};
  return Assemble(key, revision, std::move(parts), std::move(loaded_frames));
}

StatusOr<std::shared_ptr<const LoadedTile>> LoadedTile::With(const TileChange& change, Revision revision) const {
  std::shared_ptr<const Frames> frames = MergeFrames(frames_, change.frames);
  std::vector<MapPointId> replaced = change.removed;
  std::vector<LoadedPoint> points;
  points.reserve(change.upserted.size());
  for (const PointRecord& record : change.upserted) {
    replaced.push_back(record.id);
    points.push_back(Load(record, frames->list, frames->index));
  }
  std::sort(replaced.begin(), replaced.end());

  std::vector<Part> parts = parts_;
  Hide(parts, replaced);
  if (!points.empty()) {
    MAPP_ASSIGN_OR_RETURN(Part part, BuildPart(std::move(points)));
    parts.push_back(std::move(part));
  }
  return Assemble(key_, revision, std::move(parts), std::move(frames));
}

}  // namespace mapp
