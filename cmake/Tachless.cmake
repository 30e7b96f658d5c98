# Settings that all targets share. They are set on targets, never on directories.

# Sources of a target are compiled in batches, because most compile time goes into their common headers.
option(TACHLESS_UNITY "Compile the sources of a target in batches" ON)

include(GNUInstallDirs)
set(TACHLESS_LIBDIR ${CMAKE_INSTALL_LIBDIR}/tachless)

# Clang compiles in three quarters of the time with an allocator that asks for large pages (decision 0025).
find_library(PATH_OF_mimalloc mimalloc)
if(PATH_OF_mimalloc AND CMAKE_CXX_COMPILER_ID STREQUAL "Clang" AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER env LD_PRELOAD=${PATH_OF_mimalloc} MIMALLOC_LARGE_OS_PAGES=1)
endif()

add_library(tachless_options INTERFACE)
target_link_libraries(tachless_options INTERFACE fmt::fmt)
target_include_directories(tachless_options INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>)
# The results do not depend on the processor: every amd64 machine writes and replays the same bits. This needs
# no contraction, and the functions of core/base/elementary.h instead of libm's.
target_compile_options(tachless_options INTERFACE -Wall -Wextra -Wpedantic -ffp-contract=off)
if(NOT TACHLESS_UNITY)  # in a batch, a local name may equal a name of another source
  target_compile_options(tachless_options INTERFACE -Wshadow)
endif()
# The libraries go into the Python module too. Calls within a library stay direct.
target_compile_options(tachless_options INTERFACE -fPIC -fno-semantic-interposition)
# The programs take datagrams from strangers: a write beyond an array ends the program. Sanitizers have checks of
# their own. Decision 0026 has the cost.
if(NOT CMAKE_CXX_FLAGS MATCHES "sanitize")
  target_compile_options(tachless_options INTERFACE $<BUILD_INTERFACE:-fstack-protector-strong>
    "$<BUILD_INTERFACE:$<$<CONFIG:Release,RelWithDebInfo,MinSizeRel>:-U_FORTIFY_SOURCE;-D_FORTIFY_SOURCE=2>>")
endif()
# g++ collects no garbage: a large batch compiles in four fifths of the time, with a fifth more memory (2.3 GB).
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  target_compile_options(tachless_options INTERFACE $<BUILD_INTERFACE:--param=ggc-min-heapsize=4000000>)
endif()
# g++ 12 reports std::string's own copying as a write beyond its bounds if it inlines the concatenation of a
# literal and a string (GCC bug 105651).
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  target_compile_options(tachless_options INTERFACE -Wno-array-bounds -Wno-restrict
    -Wno-stringop-overflow -Wno-stringop-overread)
endif()

# Installs a library that others may link as tachless::name.
function(tachless_export name)
  set_property(GLOBAL APPEND PROPERTY TACHLESS_LIBRARIES ${name})
  install(TARGETS ${name} EXPORT tachless COMPONENT development ARCHIVE DESTINATION ${TACHLESS_LIBDIR}
    INCLUDES DESTINATION include include/tachless)
endfunction()
tachless_export(tachless_options)

# Headers that most sources include, parsed once. Each source still includes the headers it uses, because the
# preset `dev` builds without precompiled headers.
set(TACHLESS_COMMON_HEADERS <Eigen/Dense> <fmt/format.h> <algorithm> <array> <chrono> <cmath> <filesystem>
  <fstream> <functional> <map> <memory> <optional> <span> <stdexcept> <string> <string_view> <variant> <vector>)
file(WRITE ${PROJECT_BINARY_DIR}/empty.cpp "")
# Further headers that most sources of analysis/ and tools/ include.
set(TACHLESS_SCENARIO_HEADERS <core/scenario/scenario.h> <core/messages/measurements.h> <nlohmann/json.hpp>)
# tachless_precompile(name [header …]): precompiles the common headers, and further ones.
function(tachless_precompile name)
  add_library(${name} OBJECT ${PROJECT_BINARY_DIR}/empty.cpp)
  target_link_libraries(${name} PRIVATE tachless_options Eigen3::Eigen)
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/core)
  target_precompile_headers(${name} PRIVATE ${TACHLESS_COMMON_HEADERS} ${ARGN})
endfunction()
tachless_precompile(common_headers)
tachless_precompile(scenario_headers ${TACHLESS_SCENARIO_HEADERS})
# analysis/CMakeLists.txt gives the reason. Under the thread sanitizer, one test alone computes there.
target_compile_options(scenario_headers PRIVATE $<$<CONFIG:Release>:-O1>)
if(CMAKE_CXX_FLAGS MATCHES "sanitize=thread")
  target_compile_options(scenario_headers PRIVATE -O0)
endif()
# The headers of libraries that compute little: of tools/, and of bus, scenario and logger/. Under the sanitizers, -O0
# halves the time to compile.
set(TACHLESS_TOOL_HEADERS scenario_headers)
set(TACHLESS_PLAIN_HEADERS common_headers)
if(CMAKE_CXX_FLAGS MATCHES "sanitize")
  tachless_precompile(tool_headers ${TACHLESS_SCENARIO_HEADERS})
  tachless_precompile(plain_headers)
  target_compile_options(tool_headers PRIVATE -O0)
  target_compile_options(plain_headers PRIVATE -O0)
  set(TACHLESS_TOOL_HEADERS tool_headers)
  set(TACHLESS_PLAIN_HEADERS plain_headers)
endif()
set(TACHLESS_HEADERS common_headers)

# Compiles a target with the headers above and their options, and its sources in batches.
function(tachless_compile_fast name headers)
  target_precompile_headers(${name} REUSE_FROM ${headers})
  target_compile_options(${name} PRIVATE $<TARGET_PROPERTY:${headers},COMPILE_OPTIONS>)
  get_target_property(sources ${name} SOURCES)
  list(LENGTH sources number)
  math(EXPR batches "(${number} + 7) / 8")
  math(EXPR size "(${number} + ${batches} - 1) / ${batches}")
  set_target_properties(${name} PROPERTIES UNITY_BUILD ${TACHLESS_UNITY} UNITY_BUILD_BATCH_SIZE ${size})
endfunction()

# Adds the include folders of a library. #include "robot/model.h" starts in the root or in the library's
# district: core/, analysis/ or tools/. A library sees its own district and, by its links, the districts
# below.
function(tachless_include_folders name kind)
  set(folders ${PROJECT_SOURCE_DIR})
  if(CMAKE_CURRENT_SOURCE_DIR MATCHES "^${PROJECT_SOURCE_DIR}/(core|analysis|tools)/")
    list(APPEND folders ${PROJECT_SOURCE_DIR}/${CMAKE_MATCH_1})
  endif()
  target_include_directories(${name} ${kind} "$<BUILD_INTERFACE:${folders}>")
endfunction()

# tachless_library(robot SOURCES a.cpp … LIBS x …): adds a library, installed as tachless::robot. Without
# SOURCES it consists of headers alone.
function(tachless_library name)
  cmake_parse_arguments(arg "" "" "SOURCES;LIBS;PRIVATE_LIBS" ${ARGN})
  if(arg_SOURCES)
    add_library(${name} STATIC ${arg_SOURCES})
    set_property(GLOBAL APPEND_STRING PROPERTY TACHLESS_ARCHIVES " -l${name}")
    # These are header-only and used in sources only, so that users of this library do not need them.
    list(TRANSFORM arg_PRIVATE_LIBS REPLACE "^(CLI11|lcmtypes_|nlohmann_json).*" "$<BUILD_INTERFACE:\\0>")
    target_link_libraries(${name} PUBLIC ${arg_LIBS} PRIVATE tachless_options ${arg_PRIVATE_LIBS})
    tachless_include_folders(${name} PUBLIC)
    tachless_compile_fast(${name} ${TACHLESS_HEADERS})
    target_compile_features(${name} INTERFACE $<INSTALL_INTERFACE:cxx_std_20>)
  else()
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE ${arg_LIBS})
    tachless_include_folders(${name} INTERFACE)
  endif()
  tachless_export(${name})
endfunction()

# tachless_program(tachless-plant SOURCES … LIBS …): adds a program.
function(tachless_program name)
  cmake_parse_arguments(arg "" "" "SOURCES;LIBS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE tachless_options ${arg_LIBS})
  tachless_compile_fast(${name} ${TACHLESS_HEADERS})
  # The loader resolves all addresses at the start, after which their table is read-only.
  target_link_options(${name} PRIVATE -Wl,-z,relro,-z,now)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
endfunction()

# tachless_driver(tachless-ur SOURCES … LIBS …): adds the program of an arm's driver, which has a package of its
# own with a man page.
function(tachless_driver name)
  tachless_program(${name} ${ARGN})
  set_property(GLOBAL APPEND PROPERTY TACHLESS_DRIVERS ${name})
  string(REPLACE "-" "_" component ${name})
  install(TARGETS ${name} DESTINATION bin COMPONENT ${component})
endfunction()

# Precompiles the headers for the test programs, which have other options. The checked code is in the libraries;
# the test itself should compile fast. Under the sanitizers, -O0 takes a third of the compile time of -O1.
# A test that computes with inline code takes `optimised_test_headers`.
function(tachless_test_headers)
  tachless_add_test_headers(optimised_test_headers -O1)
  if(CMAKE_BUILD_TYPE STREQUAL Release)
    add_library(test_headers ALIAS optimised_test_headers)
  else()
    tachless_add_test_headers(test_headers -O0)
  endif()
endfunction()

function(tachless_add_test_headers name optimisation)
  add_library(${name} OBJECT ${PROJECT_BINARY_DIR}/empty.cpp)
  tachless_test_options(${name})
  target_compile_options(${name} PRIVATE ${optimisation})
  target_link_libraries(${name} PRIVATE base)
  target_precompile_headers(${name} PRIVATE <gmock/gmock.h> <gtest/gtest.h>
    ${TACHLESS_COMMON_HEADERS} ${TACHLESS_SCENARIO_HEADERS} <random> <regex> <sstream> <thread>)
endfunction()

# Gives all test programs the same options, because they share the headers above.
function(tachless_test_options name)
  target_link_libraries(${name} PRIVATE tachless_options GTest::gmock GTest::gtest_main)
  target_compile_definitions(${name} PRIVATE TACHLESS_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
    TACHLESS_BINARY_DIR="${PROJECT_BINARY_DIR}")
endfunction()

# tachless_test(name SOURCES … LIBS … [LABELS …] [TIMEOUT s] [EACH prefix] [SLOW] [THREADS] [APART]
# [COMPUTES] [WAITS]): adds a GoogleTest program and its CTest entry. EACH: every source x_test.cpp has a CTest entry
# prefix_x of its own. One program of many sources compiles faster than many programs. SLOW: the test starts whole
# programs, or computes for more than some seconds. It gets the label `slow` and belongs to the target `slow_tests`.
# All others get the label `fast` and belong to the target `fast_tests`. They also run under the address and
# undefined-behaviour sanitizers. THREADS: more than one thread runs the project's code. Such a test gets the label
# `threads`, belongs to the target `thread_tests`, and runs under the thread sanitizer. APART: the sources use equal
# names and are compiled one by one. COMPUTES: inline code of the test takes most of its time under the sanitizers.
# The linker takes an inline function from the test's object, so the library's calls of that function count too.
# WAITS: the test waits most of its time. It takes one of four places, and every other test takes two.
function(tachless_test name)
  cmake_parse_arguments(arg "SLOW;THREADS;APART;COMPUTES;WAITS" "TIMEOUT;EACH" "SOURCES;LIBS;LABELS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  tachless_test_options(${name})
  target_link_libraries(${name} PRIVATE ${arg_LIBS} base)
  if(arg_COMPUTES)
    tachless_compile_fast(${name} optimised_test_headers)
  else()
    tachless_compile_fast(${name} test_headers)
  endif()
  if(arg_APART)
    set_target_properties(${name} PROPERTIES UNITY_BUILD OFF)
  endif()
  if(arg_EACH)
    tachless_test_entries(${name} ${arg_EACH} ${arg_SOURCES})
  else()
    add_test(NAME ${name} COMMAND ${name})
    set(entries ${name})
  endif()
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 300)
  endif()
  if(arg_SLOW)
    list(APPEND arg_LABELS slow)
    add_dependencies(slow_tests ${name})
  else()
    list(APPEND arg_LABELS fast)
    add_dependencies(fast_tests ${name})
  endif()
  if(arg_THREADS)
    list(APPEND arg_LABELS threads)
    add_dependencies(thread_tests ${name})
  endif()
  set(places 2)
  if(arg_WAITS)
    set(places 1)
  endif()
  set_tests_properties(${entries} PROPERTIES LABELS "${arg_LABELS}" TIMEOUT ${arg_TIMEOUT} PROCESSORS ${places})
endfunction()

# Adds a CTest entry prefix_x for each source x_test.cpp of a test program, which runs the suites that the source
# has. Sets `entries` to their names.
function(tachless_test_entries program prefix)
  set(entries)
  set(all_suites)
  foreach(source IN LISTS ARGN)
    if(NOT source MATCHES "([a-z0-9_]+)_test\\.cpp$")
      continue()
    endif()
    set(entry ${prefix}_${CMAKE_MATCH_1})
    file(STRINGS ${source} suites REGEX "^(TYPED_)?TEST(_[FP])?\\(")
    if(NOT suites)
      message(FATAL_ERROR "${source} of ${program} has no test at the begin of a line")
    endif()
    list(TRANSFORM suites REPLACE "^[A-Z_]+\\(([A-Za-z0-9]+),.*" "\\1")
    list(REMOVE_DUPLICATES suites)
    foreach(suite IN LISTS suites)
      if(suite IN_LIST all_suites)
        message(FATAL_ERROR "${source} of ${program} has the suite ${suite}, which another source has: it would run twice")
      endif()
    endforeach()
    list(APPEND all_suites ${suites})
    list(TRANSFORM suites REPLACE "(.+)" "\\1.*:*/\\1.*:\\1/*")
    list(JOIN suites ":" filter)
    add_test(NAME ${entry} COMMAND ${program} --gtest_filter=${filter})
    list(APPEND entries ${entry})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${source})
  endforeach()
  set(entries ${entries} PARENT_SCOPE)
endfunction()

# tachless_syntax_test(name FILE f.cpp LIBS … [FORBIDDEN] [FAILS] [CHECK command]): tests that f.cpp compiles with the
# include directories of LIBS; with FAILS, that it does not compile. The compiler's command line follows that of CHECK.
function(tachless_syntax_test name)
  cmake_parse_arguments(arg "FORBIDDEN;FAILS" "FILE" "LIBS;CHECK" ${ARGN})
  set(compile ${arg_CHECK} ${CMAKE_CXX_COMPILER} -std=c++20 -fsyntax-only)
  foreach(library IN LISTS arg_LIBS)
    set(folders $<FILTER:$<TARGET_PROPERTY:${library},INTERFACE_INCLUDE_DIRECTORIES>,EXCLUDE,^$>)
    list(APPEND compile "-I$<JOIN:${folders},$<SEMICOLON>-I>")
  endforeach()
  if(arg_FORBIDDEN)
    list(APPEND compile -DFORBIDDEN)
  endif()
  add_test(NAME ${name} COMMAND ${compile} ${CMAKE_CURRENT_SOURCE_DIR}/${arg_FILE} COMMAND_EXPAND_LISTS)
  set_tests_properties(${name} PROPERTIES LABELS "compile_fail;slow" PROCESSORS 2)
  if(arg_FAILS)
    set_tests_properties(${name} PROPERTIES WILL_FAIL TRUE)
  endif()
endfunction()

# tachless_compile_fail(name FILE f.cpp LIBS …): passes if f.cpp compiles without -DFORBIDDEN and fails to
# compile with -DFORBIDDEN. The refusal then has one cause.
function(tachless_compile_fail name)
  tachless_syntax_test(${name}_twin_compiles ${ARGN})
  tachless_syntax_test(${name}_does_not_compile ${ARGN} FORBIDDEN FAILS)
endfunction()
