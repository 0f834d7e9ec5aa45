-- What devices on a shared map have found of its points, what was derived from that, and the changes of the world that
-- it tells of.

-- Raw data, append only, as long as its session is there.
CREATE TABLE evidence (
  session_id  INTEGER NOT NULL REFERENCES sessions (session_id),
  number      INTEGER NOT NULL,  -- the session's own, from 0; (session_id, number) makes a report idempotent
  received_ns INTEGER NOT NULL,
  crc32c      INTEGER NOT NULL,  -- of packet
  packet      BLOB NOT NULL      -- core/codec/evidence_codec.h
) STRICT;
CREATE UNIQUE INDEX evidence_by_number ON evidence (session_id, number);

-- Derived: may be dropped and made again.
CREATE TABLE findings (
  session_id INTEGER PRIMARY KEY REFERENCES sessions (session_id),
  crc32c     INTEGER NOT NULL,  -- of blob
  blob       BLOB NOT NULL      -- in the format of who derives them
) STRICT;

CREATE TABLE changes (
  change_id         INTEGER PRIMARY KEY AUTOINCREMENT,
  map_id            INTEGER NOT NULL REFERENCES maps (map_id),
  kind              INTEGER NOT NULL,  -- 1 appeared, 2 vanished, 3 moved
  status            INTEGER NOT NULL,  -- 1 proposed, 2 accepted, 3 rejected
  confidence        REAL NOT NULL,     -- probability in [0, 1] that it has happened
  -- It happened between after_ns and before_ns; first_seen_ns and last_seen_ns: where it was (appeared: where it is).
  after_ns          INTEGER NOT NULL,
  before_ns         INTEGER NOT NULL,
  first_seen_ns     INTEGER NOT NULL,
  last_seen_ns      INTEGER NOT NULL,
  detected_revision INTEGER NOT NULL,  -- the map's when it was found
  applied_revision  INTEGER,           -- that its acceptance made; NULL = none
  -- T_map_box at the box's centre and its edges: where the thing was, all NULL for appeared
  before_tx_m REAL, before_ty_m REAL, before_tz_m REAL, before_qw REAL, before_qx REAL, before_qy REAL, before_qz REAL,
  before_size_x_m REAL, before_size_y_m REAL, before_size_z_m REAL,
  -- where it is, all NULL for vanished
  after_tx_m REAL, after_ty_m REAL, after_tz_m REAL, after_qw REAL, after_qx REAL, after_qy REAL, after_qz REAL,
  after_size_x_m REAL, after_size_y_m REAL, after_size_z_m REAL,
  sessions          BLOB NOT NULL,     -- whose evidence it rests on: ascending ids, docs/formats/database.md
  points_before     BLOB NOT NULL,     -- of the thing where it was, likewise
  points_after      BLOB NOT NULL      -- of the thing where it is, likewise
) STRICT;
CREATE INDEX changes_by_map ON changes (map_id);
