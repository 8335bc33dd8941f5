# How every library and program of the project is made. A target is one folder, or a stated list of folders: all sources in
# them belong to it, and a new file needs no line in any CMake file.

# Of a build of our own; a project that adds this one has its own.
if(PROJECT_IS_TOP_LEVEL)
  if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "" FORCE)
  endif()
  # Assertions stay on in RelWithDebInfo (they are cheap by rule); Release drops them. Who joins sources for speed does without
  # the lines of a stack, which take a twelfth of the time to compile.
  set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O3")
  if(NOT CMAKE_UNITY_BUILD)
    string(APPEND CMAKE_CXX_FLAGS_RELWITHDEBINFO " -g1")
  endif()
  # A Debug build is for the debugger, and still flies: answers take 2 times as long as above, with CMake's own flags 17 times.
  # These are had by "-O0 -g".
  if(CMAKE_CXX_FLAGS_DEBUG STREQUAL "-g")
    set(CMAKE_CXX_FLAGS_DEBUG "-Og -g")
  endif()
endif()
# Components of what is installed are the Debian packages: tools are programs, dev is all else.
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME dev)
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

# nearmesh_compile_options(TARGET): warnings and the flags that answers depend on.
function(nearmesh_compile_options target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wshadow -Wconversion
                                           -Wno-sign-conversion
                         # Designated initialisers leave the rest to its stated default.
                                           -Wno-missing-field-initializers
                         # g++ 12 sees overlaps in std::string that are not there (its bug 105651).
                         $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
                         # Sources that are joined are no header.
                         $<$<AND:$<COMPILE_LANG_AND_ID:CXX,GNU>,$<BOOL:${CMAKE_UNITY_BUILD}>>:-Wno-subobject-linkage>
                         # g++ 14 takes any reference that a function is given for the one that it returns.
                         $<$<AND:$<COMPILE_LANG_AND_ID:CXX,GNU>,$<VERSION_GREATER_EQUAL:$<CXX_COMPILER_VERSION>,13>>:-Wno-dangling-reference>
                         # Answers must be the same bits everywhere: no fused multiply-add.
                         -ffp-contract=off)
  if(NEARMESH_CHECK_ODR)
    nearmesh_keep_types(${target})
  endif()
endfunction()

# nearmesh_compile_quickly(TARGET): of command lines and tests, whose work is done in the libraries: saves a quarter to two
# fifths of the time to compile them. What is installed, a Release, is optimised as a whole.
function(nearmesh_compile_quickly target)
  if(CMAKE_BUILD_TYPE STREQUAL "RelWithDebInfo")
    target_compile_options(${target} PRIVATE -O1)
  endif()
endfunction()

# nearmesh_inside(TARGET): sees the headers that stay inside the project, named from its root: "core/demand/collect.hpp".
function(nearmesh_inside target)
  target_include_directories(${target} PRIVATE ${PROJECT_SOURCE_DIR})
endfunction()

# nearmesh_find_sources(OUT FOLDERS...): all sources in the folders.
function(nearmesh_find_sources out)
  set(found)
  foreach(folder ${ARGN})
    if(NOT IS_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/${folder})
      message(FATAL_ERROR "${CMAKE_CURRENT_SOURCE_DIR}/${folder}: no such folder")
    endif()
    file(GLOB sources CONFIGURE_DEPENDS ${folder}/*.cpp)
    list(APPEND found ${sources})
  endforeach()
  set(${out} ${found} PARENT_SCOPE)
endfunction()

# nearmesh_add_library(NAME [INSTALLED] FOLDERS ... [SOURCES generated ...] [USES ...] [PRIVATE_USES ...] [FOR_EACH_TARGET ...])
# The static library nearmesh_NAME, alias nearmesh::NAME, of these rooms. Its public headers lie in include/nearmesh beside
# the rooms. INSTALLED: with those headers; else it serves the programs and tests of this project alone.
# Where sources are compiled many at once (CMAKE_UNITY_BUILD), those of a room are one file, but for these FOR_EACH_TARGET: Highway
# compiles such a file once for each instruction set, so it stands alone.
function(nearmesh_add_library name)
  cmake_parse_arguments(ARG "INSTALLED" "" "FOLDERS;SOURCES;USES;PRIVATE_USES;FOR_EACH_TARGET" ${ARGN})
  nearmesh_find_sources(sources ${ARG_FOLDERS})
  list(REMOVE_ITEM sources ${CMAKE_CURRENT_SOURCE_DIR}/program/main.cpp)  # the program itself
  add_library(nearmesh_${name} STATIC ${sources} ${ARG_SOURCES})
  add_library(nearmesh::${name} ALIAS nearmesh_${name})
  set_target_properties(nearmesh_${name} PROPERTIES EXPORT_NAME ${name} UNITY_BUILD_MODE GROUP)
  list(TRANSFORM ARG_FOR_EACH_TARGET PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/)
  foreach(source ${sources})
    if(NOT source IN_LIST ARG_FOR_EACH_TARGET)
      cmake_path(GET source PARENT_PATH folder)
      cmake_path(GET folder FILENAME room)
      set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${room})
    endif()
  endforeach()
  target_compile_features(nearmesh_${name} PUBLIC cxx_std_20)
  target_include_directories(nearmesh_${name} PUBLIC
    $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  nearmesh_inside(nearmesh_${name})
  target_link_libraries(nearmesh_${name} PUBLIC ${ARG_USES} PRIVATE ${ARG_PRIVATE_USES})
  # Hidden visibility leaves instances of the standard library's templates over our types (vtables of futures, say)
  # visible, since namespace std says so; a host's shared library shall not export these either.
  target_link_options(nearmesh_${name} INTERFACE LINKER:--exclude-libs,libnearmesh_${name}.a)
  nearmesh_compile_options(nearmesh_${name})
  if(ARG_INSTALLED)
    set_property(GLOBAL APPEND PROPERTY NEARMESH_LIBRARIES nearmesh_${name})
    cmake_path(GET CMAKE_CURRENT_SOURCE_DIR FILENAME wing)
    foreach(room ${ARG_FOLDERS})
      set(headers ${CMAKE_CURRENT_SOURCE_DIR}/include/nearmesh/${wing}/${room})
      if(NEARMESH_INSTALL AND IS_DIRECTORY ${headers})
        install(DIRECTORY ${headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/nearmesh/${wing} FILES_MATCHING PATTERN *.hpp)
      endif()
    endforeach()
  endif()
endfunction()

# nearmesh_add_program(NAME SOURCES ... [USES ...]): an executable of these sources.
function(nearmesh_add_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;USES" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ${ARG_USES})
  nearmesh_inside(${name})
  nearmesh_compile_options(${name})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
endfunction()

# nearmesh_add_program_room(NAME LIBRARY [USES ...]): the program NAME of the room ./program: its main.cpp, and all else as
# the library nearmesh::LIBRARY, so that tests reach what a program is made of.
function(nearmesh_add_program_room name library)
  cmake_parse_arguments(ARG "" "" "USES" ${ARGN})
  nearmesh_add_library(${library} FOLDERS program USES ${ARG_USES})
  nearmesh_compile_quickly(nearmesh_${library})
  nearmesh_add_program(${name} SOURCES program/main.cpp USES nearmesh::${library})
  nearmesh_compile_quickly(${name})
  # Under sanitizers a program's flags and prints take clang most of its time: 7 s a main.cpp instead of 18.
  if(NEARMESH_FUZZ)
    target_compile_options(nearmesh_${library} PRIVATE -O0)
    target_compile_options(${name} PRIVATE -O0)
  endif()
endfunction()
