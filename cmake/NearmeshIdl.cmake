# Types from IDL at build time: generated code of one Fast DDS does not compile with another, so it is never committed.

find_package(fastcdr REQUIRED)
find_package(fastrtps 2.9 REQUIRED)
find_program(FASTDDSGEN fastddsgen REQUIRED)

# nearmesh_generate_types(IDL FOLDER OUT_SOURCES)
# Generates FOLDER/NAME{,PubSubTypes}.{h,cxx} from IDL. Never with -typeobject: its registration races with discovery
# (crash seen in 2.9.1).
function(nearmesh_generate_types idl folder out_sources)
  get_filename_component(idl ${idl} ABSOLUTE)
  get_filename_component(name ${idl} NAME_WE)
  file(MAKE_DIRECTORY ${folder})
  set(stem ${folder}/${name})
  add_custom_command(
    OUTPUT ${stem}.h ${stem}.cxx ${stem}PubSubTypes.h ${stem}PubSubTypes.cxx
    COMMAND ${FASTDDSGEN} -replace -cs -d ${folder} ${idl}
    DEPENDS ${idl}
    COMMENT "Generating DDS types from ${name}.idl"
    VERBATIM)
  set(${out_sources} ${stem}.h ${stem}.cxx ${stem}PubSubTypes.h ${stem}PubSubTypes.cxx PARENT_SCOPE)
endfunction()
