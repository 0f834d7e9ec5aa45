#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "storage/sqlite/connection.h"

namespace mapp::sqlite {

/// From now on, what this connection reads of `map` is of `revision`, and it finds no other map: temporary views stand
/// before the tables of the same names, so that every query serves both. Inside a snapshot that the connection keeps
/// open; one pass over the map's points. NOT_FOUND: no such map. OUT_OF_RANGE: no such revision.
Status ShowAsOf(Connection& db, MapId map, Revision revision);

}  // namespace mapp::sqlite
