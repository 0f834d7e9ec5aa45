-- The settings of the feature extractor that a map's sessions must share, from the session that created it. The maps
-- there were so far were made with the defaults: nobody told others.
ALTER TABLE maps ADD COLUMN feature_descriptor TEXT NOT NULL DEFAULT 'ORB-256';  -- name of the descriptor's kind
ALTER TABLE maps ADD COLUMN feature_scale_factor REAL NOT NULL DEFAULT 1.2;      -- of neighbouring pyramid levels
ALTER TABLE maps ADD COLUMN feature_num_levels INTEGER NOT NULL DEFAULT 8;       -- octaves are below it
ALTER TABLE maps ADD COLUMN feature_patch_size_px INTEGER NOT NULL DEFAULT 31;   -- edge of the descriptor's patch
