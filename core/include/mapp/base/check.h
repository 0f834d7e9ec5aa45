#pragma once

#include <cstdio>
#include <cstdlib>

/// For programmer errors only. No byte that a client or a file can supply may reach one.
#define MAPP_CHECK(condition)                                                            \
  do {                                                                                   \
    if (!(condition)) {                                                                  \
      std::fprintf(stderr, "%s:%d: check failed: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                      \
    }                                                                                    \
  } while (false)
