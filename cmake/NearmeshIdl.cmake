# Fast DDS, and types from IDL at build time: generated code of one Fast DDS does not compile with another, so it is never
# committed. What differs between Fast DDS 2.9 (Debian 12) and 3.1 (Debian 13) is here and in idl/dds/fastdds_api.hpp.

find_package(fastcdr REQUIRED)
find_package(fastdds 3.1 QUIET)
if(fastdds_FOUND)
  set(NEARMESH_FASTDDS fastdds)
else()
  find_package(fastrtps 2.9 REQUIRED)
  set(NEARMESH_FASTDDS fastrtps)
endif()
find_program(FASTDDSGEN fastddsgen REQUIRED)

# nearmesh_generate_types(IDL FOLDER OUT_SOURCES)
# Generates types from NAME.idl into FOLDER, and NAME_types.hpp, which includes what their users need. Never with type
# objects: their registration races with discovery (crash seen in 2.9.1).
function(nearmesh_generate_types idl folder out_sources)
  get_filename_component(idl ${idl} ABSOLUTE)
  get_filename_component(name ${idl} NAME_WE)
  file(MAKE_DIRECTORY ${folder})
  if(NEARMESH_FASTDDS STREQUAL "fastdds")
    set(headers ${name}.hpp ${name}CdrAux.hpp ${name}PubSubTypes.hpp)
    set(made ${headers} ${name}CdrAux.ipp ${name}PubSubTypes.cxx)
    set(options -no-typeobjectsupport -flat-output-dir)
  else()
    set(headers ${name}.h ${name}PubSubTypes.h)
    set(made ${headers} ${name}.cxx ${name}PubSubTypes.cxx)
    set(options)
  endif()
  list(TRANSFORM headers REPLACE "(.+)" "#include \"\\1\"\n" OUTPUT_VARIABLE includes)
  list(JOIN includes "" includes)
  file(CONFIGURE OUTPUT ${folder}/${name}_types.hpp CONTENT "#pragma once\n@includes@" @ONLY)
  list(TRANSFORM made PREPEND ${folder}/)
  add_custom_command(
    OUTPUT ${made}
    COMMAND ${FASTDDSGEN} -replace -cs ${options} -d ${folder} ${idl}
    DEPENDS ${idl}
    COMMENT "Generating DDS types from ${name}.idl"
    VERBATIM)
  set(${out_sources} ${made} PARENT_SCOPE)
endfunction()
