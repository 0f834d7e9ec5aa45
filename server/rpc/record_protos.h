#pragma once

#include "mapp/v1/admin_service.pb.h"
#include "storage/records.h"

namespace mapp {

/// Stored records as operators see them.
v1::MapInfo ToProto(const MapRecord& map);
v1::SessionInfo ToProto(const SessionRecord& session, const std::string& map_name);
v1::ExportedFrame ToProto(const FrameRecord& frame);
v1::ExportedPoint ToProto(const PointRecord& point);
v1::Change ToProto(const ChangeRecord& change);

}  // namespace mapp
