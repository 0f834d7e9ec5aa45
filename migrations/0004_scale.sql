-- Sessions of a single camera tell lengths in a unit of their own, and may found a map whose unit is none either.
ALTER TABLE sessions ADD COLUMN scale_map_session REAL NOT NULL DEFAULT 1;   -- metres a unit of the session's; > 0
ALTER TABLE maps ADD COLUMN has_metric_scale INTEGER NOT NULL DEFAULT 1;     -- boolean; 0: a `_m` of this map is no metre
