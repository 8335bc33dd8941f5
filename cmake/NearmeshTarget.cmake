# One way to make a target, so that every library and program of the project is compiled alike.

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "" FORCE)
endif()
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
# Assertions stay on in RelWithDebInfo (they are cheap by rule); Release drops them.
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O3 -g1")

# nearmesh_compile_options(TARGET): warnings and the flags that answers depend on.
function(nearmesh_compile_options target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wshadow -Wconversion
                                           -Wno-sign-conversion
                         # Designated initialisers leave the rest to its stated default.
                                           -Wno-missing-field-initializers
                         # g++ 12 sees overlaps in std::string that are not there (its bug 105651).
                         $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
                         # Answers must be the same bits everywhere: no fused multiply-add.
                         -ffp-contract=off)
endfunction()

# nearmesh_compile_quickly(TARGET): of command lines and tests, whose work is done in the libraries: saves a quarter to two
# fifths of the time to compile them. What is installed, a Release, is optimised as a whole.
function(nearmesh_compile_quickly target)
  if(CMAKE_BUILD_TYPE STREQUAL "RelWithDebInfo")
    target_compile_options(${target} PRIVATE -O1)
  endif()
endfunction()

# nearmesh_add_library(NAME SOURCES ... [PUBLIC_DEPS ...] [PRIVATE_DEPS ...])
# Makes the static library nearmesh_NAME, alias nearmesh::NAME, with ./include as its public folder.
function(nearmesh_add_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC_DEPS;PRIVATE_DEPS" ${ARGN})
  add_library(nearmesh_${name} STATIC ${ARG_SOURCES})
  add_library(nearmesh::${name} ALIAS nearmesh_${name})
  set_target_properties(nearmesh_${name} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(nearmesh_${name} PUBLIC cxx_std_20)
  target_include_directories(nearmesh_${name} PUBLIC
    $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(nearmesh_${name} PUBLIC ${ARG_PUBLIC_DEPS} PRIVATE ${ARG_PRIVATE_DEPS})
  # Hidden visibility leaves instances of the standard library's templates over our types (vtables of futures, say)
  # visible, since namespace std says so; a host's shared library shall not export these either.
  target_link_options(nearmesh_${name} INTERFACE LINKER:--exclude-libs,libnearmesh_${name}.a)
  nearmesh_compile_options(nearmesh_${name})
  set_property(GLOBAL APPEND PROPERTY NEARMESH_LIBRARIES nearmesh_${name})
endfunction()

# nearmesh_add_program(NAME SOURCES ... DEPS ...)
function(nearmesh_add_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS})
  nearmesh_compile_options(${name})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
endfunction()
