# The only ways this project declares targets. Sources are listed one by one: a file nobody lists is a file
# nobody builds, and for tests that fails the configure step (see mapp_check_all_listed).

add_library(mapp_flags INTERFACE)
target_compile_options(mapp_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor -Woverloaded-virtual)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  # g++ 12 sees overlapping copies in std::string's operator+ that are not there (GCC bug 105651).
  target_compile_options(mapp_flags INTERFACE -Wno-restrict)
endif()
if(MAPP_WARNINGS_AS_ERRORS)
  target_compile_options(mapp_flags INTERFACE -Werror)
endif()

# Level v2 keeps Eigen's alignment at 16 bytes, so objects mix with Debian's Ceres; AVX would not.
if(MAPP_X86_64_V2 AND CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64")
  add_compile_options(-march=x86-64-v2)
endif()
if(MAPP_SANITIZE)
  add_compile_options(-fsanitize=${MAPP_SANITIZE} -fno-omit-frame-pointer)
  add_link_options(-fsanitize=${MAPP_SANITIZE})
endif()

# Three quarters of the time of a build from nothing go into reading the same headers again. scripts/build therefore
# compiles several sources as one; a developer's build does not, so that an edit compiles one file and ccache knows the
# others.
option(MAPP_UNITY "Compile several sources as one: much faster from nothing, slower after an edit" OFF)

# mapp_join_sources(target [source...]): the sources given stand apart, because they use names of the others.
function(mapp_join_sources target)
  if(NOT MAPP_UNITY)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 14)
  set_source_files_properties(${ARGN} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  # A joined source counts as a header to g++, which then warns of what is private to it.
  target_compile_options(${target} PRIVATE -Wno-subobject-linkage)
endfunction()

# mapp_add_library(NAME core SRCS a.cc [HEADERS_DIR include] [PUBLIC libs] [PRIVATE libs] [APART b.cc])
# Creates mapp_<name> with the alias mapp::<name>. Headers are included from the repository's root, or from
# HEADERS_DIR for the two modules that promise an interface (core, client_sdk).
function(mapp_add_library)
  cmake_parse_arguments(ARG "" "NAME;HEADERS_DIR" "SRCS;PUBLIC;PRIVATE;APART" ${ARGN})
  add_library(mapp_${ARG_NAME} STATIC ${ARG_SRCS})
  mapp_join_sources(mapp_${ARG_NAME} ${ARG_APART})
  add_library(mapp::${ARG_NAME} ALIAS mapp_${ARG_NAME})
  set_target_properties(mapp_${ARG_NAME} PROPERTIES EXPORT_NAME ${ARG_NAME})
  if(ARG_HEADERS_DIR)
    target_include_directories(mapp_${ARG_NAME} PUBLIC
      $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/${ARG_HEADERS_DIR}> $<INSTALL_INTERFACE:include>)
  endif()
  target_include_directories(mapp_${ARG_NAME} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>)
  target_link_libraries(mapp_${ARG_NAME} PUBLIC ${ARG_PUBLIC}
    PRIVATE $<BUILD_INTERFACE:mapp_flags> ${ARG_PRIVATE})
endfunction()

# mapp_add_executable(NAME mapp-server SRCS main.cc LIBS ...)
function(mapp_add_executable)
  cmake_parse_arguments(ARG "" "NAME" "SRCS;LIBS" ${ARGN})
  add_executable(${ARG_NAME} ${ARG_SRCS})
  target_link_libraries(${ARG_NAME} PRIVATE mapp_flags ${ARG_LIBS})
endfunction()

# mapp_add_test(NAME unit_core LABELS unit core SRCS ... LIBS ... [TIMEOUT s] [SERIAL] [TOGETHER] [APART b.cc])
# One binary a module; each TEST becomes a ctest case. TOGETHER: the binary is one case, for tests that share what takes
# long to make.
function(mapp_add_test)
  cmake_parse_arguments(ARG "SERIAL;TOGETHER" "NAME;TIMEOUT" "SRCS;LIBS;LABELS;APART" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  add_executable(${ARG_NAME} ${ARG_SRCS})
  mapp_join_sources(${ARG_NAME} ${ARG_APART})
  set_target_properties(${ARG_NAME} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  # What takes time in a test is the code under test.
  target_compile_options(${ARG_NAME} PRIVATE $<$<CONFIG:Release>:-O1>)
  target_link_libraries(${ARG_NAME} PRIVATE mapp_flags ${ARG_LIBS} GTest::gmock GTest::gtest_main)
  target_include_directories(${ARG_NAME} PRIVATE ${PROJECT_SOURCE_DIR})
  set(serial OFF)
  if(ARG_SERIAL)
    set(serial ON)
  endif()
  # ';' between labels must survive two expansions.
  string(REPLACE ";" "\\;" labels "${ARG_LABELS}")
  if(ARG_TOGETHER)
    add_test(NAME ${ARG_NAME} COMMAND ${ARG_NAME})
    set_tests_properties(${ARG_NAME} PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT ${ARG_TIMEOUT} RUN_SERIAL ${serial})
  else()
    gtest_discover_tests(${ARG_NAME} TEST_PREFIX ${ARG_NAME}/ DISCOVERY_MODE PRE_TEST NO_PRETTY_VALUES
      PROPERTIES LABELS "${labels}" TIMEOUT ${ARG_TIMEOUT} RUN_SERIAL ${serial})
  endif()
  set_property(GLOBAL APPEND PROPERTY MAPP_TEST_SOURCES ${ARG_SRCS})
  foreach(src IN LISTS ARG_SRCS)
    set_property(GLOBAL APPEND PROPERTY MAPP_TEST_SOURCES_ABS ${CMAKE_CURRENT_SOURCE_DIR}/${src})
  endforeach()
endfunction()

# Fails the configure step when a *_test.cc under tests/ is in no target.
function(mapp_check_all_tests_listed)
  get_property(listed GLOBAL PROPERTY MAPP_TEST_SOURCES_ABS)
  file(GLOB_RECURSE found ${PROJECT_SOURCE_DIR}/tests/*_test.cc)
  foreach(file IN LISTS found)
    if(NOT file IN_LIST listed)
      message(FATAL_ERROR "${file} is in no mapp_add_test: it would never run")
    endif()
  endforeach()
endfunction()
