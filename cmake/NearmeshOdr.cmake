# The target check_odr: fails where two types of this project have one name and differ, in whatever files and rooms they
# stand. Compilers see one file at a time and linkers see no types, so both keep silent: one of the two destructors is kept,
# and runs over objects of the other type. Needs g++ (option NEARMESH_CHECK_ODR). Within a room, which a joined build compiles
# as a whole, a second type of one name is an error already.

# Each object keeps its types beside its code, which takes a twentieth more time. Nothing is linked by them: archives, which
# are installed too, hold the code alone.
foreach(language C CXX)
  set(CMAKE_${language}_ARCHIVE_FINISH
      "${CMAKE_OBJCOPY} --wildcard -R '.gnu.lto_*' -R '.gnu.debuglto_*' --strip-symbol __gnu_lto_v1 <TARGET>"
      "<CMAKE_RANLIB> <TARGET>")
endforeach()
add_link_options(-fno-lto)

# nearmesh_keep_types(TARGET): check_odr looks at it.
function(nearmesh_keep_types target)
  set_property(GLOBAL APPEND PROPERTY NEARMESH_TYPED_TARGETS ${target})
  target_compile_options(${target} PRIVATE -flto -ffat-lto-objects)
endfunction()

function(nearmesh_check_odr)
  get_property(targets GLOBAL PROPERTY NEARMESH_TYPED_TARGETS)
  set(objects)
  foreach(target ${targets})
    list(APPEND objects $<TARGET_OBJECTS:${target}>)
  endforeach()
  # All objects into one, of all programs at once (each has its main); no code is made, so this takes some seconds.
  set(out ${PROJECT_BINARY_DIR}/check_odr.o)
  add_custom_command(OUTPUT ${out}
    COMMAND ${CMAKE_CXX_COMPILER} -flto -O0 -r -flinker-output=rel -nostdlib -Wl,-z,muldefs
            -Werror=odr -Werror=lto-type-mismatch ${objects} -o ${out}
    DEPENDS ${objects} COMMAND_EXPAND_LISTS VERBATIM
    COMMENT "Looking for two types of one name")
  add_custom_target(check_odr DEPENDS ${out})
endfunction()
