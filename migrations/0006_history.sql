-- What a commit was for, names for revisions, and versions of the rest of a map's state: with these, a map AS OF any
-- revision from oldest_revision on can be read.

-- 0 unknown (from before this schema), 1 keyframe, 2 alignment, 3 loop, 4 optimization, 5 fusion, 6 rescaling,
-- 7 retirement. session_id: whose keyframe, alignment, loop, optimization or retirement it was; may be NULL.
ALTER TABLE revisions ADD COLUMN cause INTEGER NOT NULL DEFAULT 0;
UPDATE revisions SET cause = 1 WHERE session_id IS NOT NULL;

ALTER TABLE maps ADD COLUMN state_revision INTEGER NOT NULL DEFAULT 0;   -- map's revision since which founder_session_id
                                                                         -- and has_metric_scale are as they are
ALTER TABLE maps ADD COLUMN oldest_revision INTEGER NOT NULL DEFAULT 0;  -- histories before it are gone

CREATE TABLE map_history (
  map_id             INTEGER NOT NULL,
  created_revision   INTEGER NOT NULL,
  retired_revision   INTEGER NOT NULL,
  founder_session_id INTEGER,
  has_metric_scale   INTEGER NOT NULL,
  PRIMARY KEY (map_id, created_revision)
) STRICT, WITHOUT ROWID;

-- Opening, closing and quarantine make no revision of their own: they belong to the one the map had.
ALTER TABLE sessions ADD COLUMN opened_revision INTEGER NOT NULL DEFAULT 0;  -- of the map when the session was opened
ALTER TABLE sessions ADD COLUMN state_revision INTEGER NOT NULL DEFAULT 0;   -- since which the columns below are as they are

CREATE TABLE session_history (
  session_id             INTEGER NOT NULL,
  created_revision       INTEGER NOT NULL,
  retired_revision       INTEGER NOT NULL,
  closed_ns              INTEGER,
  aligned_at_keyframe    INTEGER,
  optimized_revision     INTEGER,
  tx_m REAL, ty_m REAL, tz_m REAL, qw REAL, qx REAL, qy REAL, qz REAL,
  scale_map_session      REAL NOT NULL,
  quarantined_ns         INTEGER,
  quarantine_reason      TEXT,
  quarantine_released_ns INTEGER,
  PRIMARY KEY (session_id, created_revision)
) STRICT, WITHOUT ROWID;

CREATE TABLE tags (
  map_id     INTEGER NOT NULL,
  name       TEXT NOT NULL,
  revision   INTEGER NOT NULL,
  created_ns INTEGER NOT NULL,
  PRIMARY KEY (map_id, name)
) STRICT, WITHOUT ROWID;

-- For the points that a tile had at an earlier revision.
CREATE INDEX point_history_by_tile ON point_history (tile_id) WHERE tile_id IS NOT NULL;

-- A table by rowid: in the other kind a list of some KB spills to a page of its own, most of which stays empty.
CREATE TABLE frame_observation_history_by_rowid (
  frame_id         INTEGER NOT NULL REFERENCES frames (frame_id),
  created_revision INTEGER NOT NULL,
  retired_revision INTEGER NOT NULL,
  observations     BLOB NOT NULL
) STRICT;
INSERT INTO frame_observation_history_by_rowid
  SELECT frame_id, created_revision, retired_revision, observations FROM frame_observation_history
   ORDER BY frame_id, created_revision;
DROP TABLE frame_observation_history;
ALTER TABLE frame_observation_history_by_rowid RENAME TO frame_observation_history;
CREATE UNIQUE INDEX frame_observation_history_by_frame ON frame_observation_history (frame_id, created_revision);
