-- A session whose uploads contradict the map or themselves is kept out of it until an operator lifts that.
ALTER TABLE sessions ADD COLUMN quarantined_ns INTEGER;          -- when it was found out; NULL = never
ALTER TABLE sessions ADD COLUMN quarantine_reason TEXT;          -- for operators; NULL = never
ALTER TABLE sessions ADD COLUMN quarantine_released_ns INTEGER;  -- when an operator lifted it; NULL = it stands
