# mapp_embed_migrations(DIR folder OUT variable)
# Writes a .cc that holds every NNNN_name.sql of the folder with its number, name and SHA-256, as the
# mapp::sqlite::EmbeddedMigrations() of storage/sqlite/migrator.h, and sets `variable` to its path.
# Fails unless the numbers run from 0001 without gaps.
function(mapp_embed_migrations)
  cmake_parse_arguments(ARG "" "DIR;OUT" "" ${ARGN})
  file(GLOB files CONFIGURE_DEPENDS RELATIVE ${ARG_DIR} ${ARG_DIR}/*.sql)
  list(SORT files)
  set(expected 0)
  set(entries "")
  foreach(name IN LISTS files)
    math(EXPR expected "${expected} + 1")
    if(NOT name MATCHES "^([0-9][0-9][0-9][0-9])_[a-z0-9_]+\\.sql$" OR NOT CMAKE_MATCH_1 EQUAL expected)
      message(FATAL_ERROR "${ARG_DIR}/${name}: expected migration number ${expected}, as NNNN_name.sql")
    endif()
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${ARG_DIR}/${name})
    file(READ ${ARG_DIR}/${name} sql)
    file(SHA256 ${ARG_DIR}/${name} sha256)
    string(APPEND entries
      "      {.version = ${expected}, .name = \"${name}\", .sha256 = \"${sha256}\", .sql = R\"mapp_sql(${sql})mapp_sql\"},\n")
  endforeach()

  set(generated ${CMAKE_CURRENT_BINARY_DIR}/embedded_migrations.cc)
  file(WRITE ${generated}.new
    "// Generated from migrations/ by cmake/EmbedMigrations.cmake.\n"
    "#include \"storage/sqlite/migrator.h\"\n\n"
    "namespace mapp::sqlite {\n\n"
    "std::span<const Migration> EmbeddedMigrations() {\n"
    "  static constexpr Migration kMigrations[] = {\n${entries}  };\n"
    "  return kMigrations;\n}\n\n"
    "}  // namespace mapp::sqlite\n")
  # Copied only when it differs: a configure run alone recompiles nothing.
  configure_file(${generated}.new ${generated} COPYONLY)
  set(${ARG_OUT} ${generated} PARENT_SCOPE)
endfunction()
