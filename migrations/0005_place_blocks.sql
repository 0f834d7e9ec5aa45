-- What the place index knows of a map's frames, 256 at a time, so that a start does not read every keyframe again.
-- Derived from the keyframe log: frames in no block are read from there.
CREATE TABLE place_blocks (
  map_id INTEGER NOT NULL,   -- maps.map_id
  block INTEGER NOT NULL,    -- counts from 0 within the map
  blob BLOB NOT NULL,        -- docs/formats/place_block.md
  PRIMARY KEY (map_id, block)
);
