-- Conventions of every table
--   *_ns        int64 nanoseconds, Unix time unless the column says otherwise
--   *_m         metres
--   q[wxyz]     unit quaternion, Hamilton, of the rotation in T_a_b; t[xyz]_m its translation
--   *_revision  number of a commit to the map (table revisions). A row valid from `created_revision` until before
--               `retired_revision` is what a reader AS OF R sees when created_revision <= R < retired_revision.
--   booleans    0 or 1
-- Tables named X hold the live state, X_history the versions it replaced: the live ones stay small and need no filter,
-- and AS OF R is the union of both. Nothing is ever deleted from a history when something new is written.

CREATE TABLE schema_migrations (
  version    INTEGER PRIMARY KEY,  -- number of the file in migrations/; PRAGMA user_version is the greatest
  name       TEXT NOT NULL,        -- file name
  sha256     TEXT NOT NULL,        -- of the file, hexadecimal: a released migration never changes
  applied_ns INTEGER NOT NULL
) STRICT;

-- Next number of ids that are handed out without a table of their own. Ids are never given twice.
CREATE TABLE id_sequences (
  name    TEXT PRIMARY KEY,
  next_id INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
INSERT INTO id_sequences (name, next_id) VALUES ('point', 1);

CREATE TABLE maps (
  map_id             INTEGER PRIMARY KEY AUTOINCREMENT,
  name               TEXT NOT NULL UNIQUE,
  created_ns         INTEGER NOT NULL,
  revision           INTEGER NOT NULL,  -- of the last commit; 0 = empty
  tile_edge_m        REAL NOT NULL,     -- edge of a tile's cube
  cone_range_m       REAL NOT NULL,     -- range h of a view cone
  founder_session_id INTEGER,           -- session whose frame became the frame `map`; NULL while the map is empty
  num_frames         INTEGER NOT NULL,  -- frames with in_map
  num_points         INTEGER NOT NULL,  -- live points with a tile
  num_sessions       INTEGER NOT NULL
) STRICT;

CREATE TABLE revisions (
  map_id       INTEGER NOT NULL REFERENCES maps (map_id),
  revision     INTEGER NOT NULL,
  committed_ns INTEGER NOT NULL,
  session_id   INTEGER,  -- whose keyframe it brought; NULL for corrections of what was there
  PRIMARY KEY (map_id, revision)
) STRICT, WITHOUT ROWID;

CREATE TABLE cameras (
  camera_id         INTEGER PRIMARY KEY AUTOINCREMENT,
  model             TEXT NOT NULL,     -- 'pinhole', 'radial-tangential'
  coefficients      BLOB NOT NULL,     -- n x float64, little-endian: fx, fy, cx, cy (pixels), then the model's own
  width_px          INTEGER NOT NULL,
  height_px         INTEGER NOT NULL,
  stereo_baseline_m REAL NOT NULL      -- 0 without a second camera
) STRICT;

CREATE TABLE sessions (
  session_id          INTEGER PRIMARY KEY AUTOINCREMENT,
  map_id              INTEGER NOT NULL REFERENCES maps (map_id),
  camera_id           INTEGER NOT NULL REFERENCES cameras (camera_id),
  device              TEXT NOT NULL,
  sensor              INTEGER NOT NULL,  -- 1 mono, 2 mono-inertial, 3 stereo, 4 RGB-D
  opened_ns           INTEGER NOT NULL,
  closed_ns           INTEGER,           -- NULL while open
  -- T_map_session; all NULL while the session is a fragment of its own
  tx_m REAL, ty_m REAL, tz_m REAL, qw REAL, qx REAL, qy REAL, qz REAL,
  aligned_at_keyframe INTEGER,           -- keyframe number of this session
  optimized_revision  INTEGER,           -- of the optimization after closing; NULL = still owed
  num_keyframes       INTEGER NOT NULL,
  num_upload_bytes    INTEGER NOT NULL   -- sum of the packets' sizes
) STRICT;
CREATE INDEX sessions_by_map ON sessions (map_id);

-- What devices sent, append only; everything below can be derived from it.
CREATE TABLE keyframe_log (
  frame_id    INTEGER PRIMARY KEY AUTOINCREMENT,
  session_id  INTEGER NOT NULL REFERENCES sessions (session_id),
  number      INTEGER NOT NULL,  -- keyframe number of the session; (session_id, number) makes an upload idempotent
  received_ns INTEGER NOT NULL,
  crc32c      INTEGER NOT NULL,  -- of packet
  packet      BLOB NOT NULL      -- core/codec/keyframe_codec.h
) STRICT;
CREATE UNIQUE INDEX keyframe_log_by_number ON keyframe_log (session_id, number);

-- Map frames. `frame_id` is that of the keyframe log: the packet stays out of this table so that lists stay cheap.
CREATE TABLE frames (
  frame_id         INTEGER PRIMARY KEY REFERENCES keyframe_log (frame_id),
  map_id           INTEGER NOT NULL,
  session_id       INTEGER NOT NULL,
  camera_id        INTEGER NOT NULL,
  number           INTEGER NOT NULL,  -- keyframe number of the session
  stamp_ns         INTEGER NOT NULL,  -- the device's clock
  partial          INTEGER NOT NULL,  -- redundancy control has removed features
  overlap          REAL,              -- share in [0, 1] as the device counted; NULL = not reported
  num_features     INTEGER NOT NULL,
  num_packet_bytes INTEGER NOT NULL,
  created_revision INTEGER NOT NULL,  -- of the frame
  pose_revision    INTEGER NOT NULL,  -- created_revision of the pose below
  in_map           INTEGER NOT NULL,  -- the pose is T_map_camera if 1, T_session_camera if 0
  tx_m REAL NOT NULL, ty_m REAL NOT NULL, tz_m REAL NOT NULL,
  qw REAL NOT NULL, qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL
) STRICT;

CREATE TABLE frame_pose_history (
  frame_id         INTEGER NOT NULL REFERENCES frames (frame_id),
  created_revision INTEGER NOT NULL,
  retired_revision INTEGER NOT NULL,
  in_map           INTEGER NOT NULL,
  tx_m REAL NOT NULL, ty_m REAL NOT NULL, tz_m REAL NOT NULL,
  qw REAL NOT NULL, qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL,
  PRIMARY KEY (frame_id, created_revision)
) STRICT, WITHOUT ROWID;

CREATE TABLE frame_observations (
  frame_id         INTEGER PRIMARY KEY REFERENCES frames (frame_id),
  created_revision INTEGER NOT NULL,
  observations     BLOB NOT NULL  -- feature index, point id, depth of each; docs/formats/database.md
) STRICT;

CREATE TABLE frame_observation_history (
  frame_id         INTEGER NOT NULL REFERENCES frames (frame_id),
  created_revision INTEGER NOT NULL,
  retired_revision INTEGER NOT NULL,
  observations     BLOB NOT NULL,
  PRIMARY KEY (frame_id, created_revision)
) STRICT, WITHOUT ROWID;

-- Camera centres of the frames with in_map. The map's id is a fourth axis, so that maps do not slow each other down.
-- Bounds are float32, rounded outwards: a query finds all and a few more.
CREATE VIRTUAL TABLE frame_index USING rtree (
  frame_id, map_min, map_max, x_min_m, x_max_m, y_min_m, y_max_m, z_min_m, z_max_m
);

-- Points and tiles carry no foreign keys: an upload writes a thousand of them, and `mapp verify` checks them instead.
CREATE TABLE tiles (
  tile_id    INTEGER PRIMARY KEY,
  map_id     INTEGER NOT NULL,
  tile_key   INTEGER NOT NULL,  -- x, y, z of the cube, 21 bits each, biased by 2^20, x highest
  revision   INTEGER NOT NULL,  -- of the last commit that changed the content
  num_points INTEGER NOT NULL   -- live points; 0 stays, so that the revision goes on counting
) STRICT;
CREATE UNIQUE INDEX tiles_by_key ON tiles (map_id, tile_key);

CREATE VIRTUAL TABLE tile_index USING rtree (
  tile_id, map_min, map_max, x_min_m, x_max_m, y_min_m, y_max_m, z_min_m, z_max_m
);

-- Apart from tiles: an update of a row rewrites all of it, and a tile's revision changes with every upload.
CREATE TABLE tile_blobs (
  tile_id  INTEGER PRIMARY KEY,
  revision INTEGER NOT NULL,  -- whose content the blob holds; older than the tile's when out of date
  crc32c   INTEGER NOT NULL,  -- of blob
  blob     BLOB NOT NULL      -- core/codec/tile_codec.h
) STRICT;

CREATE TABLE points (
  point_id             INTEGER PRIMARY KEY,  -- from id_sequences: ids of retired points are not used again
  session_id           INTEGER NOT NULL,     -- whose upload created it
  session_point        INTEGER NOT NULL,     -- the device's own number for it
  tile_id              INTEGER,              -- NULL: not in the map, position and direction in the session's frame
  created_revision     INTEGER NOT NULL,     -- of this version
  x_m REAL NOT NULL, y_m REAL NOT NULL, z_m REAL NOT NULL,  -- in the map's or the session's frame
  view_direction       BLOB NOT NULL,        -- 3 x float32, little-endian; unit, mean of (point - camera centre)
  descriptor           BLOB NOT NULL,        -- ORB, 32 bytes
  -- In place, without history: these follow from the observations.
  reference_distance_m REAL NOT NULL,        -- at which the point would be detected at octave 0
  num_observations     INTEGER NOT NULL,
  confidence           REAL NOT NULL,        -- probability in [0, 1] that the point is still there
  observers            BLOB NOT NULL         -- up to 4 frame ids, varints
) STRICT;
CREATE INDEX points_by_tile ON points (tile_id) WHERE tile_id IS NOT NULL;

CREATE TABLE point_history (
  point_id             INTEGER NOT NULL,
  created_revision     INTEGER NOT NULL,
  retired_revision     INTEGER NOT NULL,
  fused_into           INTEGER,              -- point that stood for it from retired_revision on; NULL otherwise
  session_id           INTEGER NOT NULL,
  session_point        INTEGER NOT NULL,
  tile_id              INTEGER,
  x_m REAL NOT NULL, y_m REAL NOT NULL, z_m REAL NOT NULL,
  view_direction       BLOB NOT NULL,
  descriptor           BLOB NOT NULL,
  reference_distance_m REAL NOT NULL,
  num_observations     INTEGER NOT NULL,
  confidence           REAL NOT NULL,
  observers            BLOB NOT NULL,
  PRIMARY KEY (point_id, created_revision)
) STRICT, WITHOUT ROWID;

-- Every point a session has created, by the device's number; the greatest point_id of a number is the current one.
CREATE TABLE session_points (
  session_id    INTEGER NOT NULL,
  session_point INTEGER NOT NULL,
  point_id      INTEGER NOT NULL,
  PRIMARY KEY (session_id, session_point, point_id)
) STRICT, WITHOUT ROWID;
