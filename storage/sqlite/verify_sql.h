#pragma once

// Parts of the texts of checks. Comparisons are written so that what is impossible fails them.

/// The greatest finite REAL.
#define MAPP_SQL_MAX "1.7976931348623157e308"

/// Whether the columns tx_m to qz are a pose: finite, the quaternion a unit one.
#define MAPP_SQL_IS_POSE                                                                            \
  "(abs(tx_m) <= " MAPP_SQL_MAX " AND abs(ty_m) <= " MAPP_SQL_MAX " AND abs(tz_m) <= " MAPP_SQL_MAX \
  " AND "                                                                                           \
  "abs(qw * qw + qx * qx + qy * qy + qz * qz - 1) <= 1e-6)"
