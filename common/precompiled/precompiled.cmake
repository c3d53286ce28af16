# Headers of other projects, parsed once for all files of a kind instead of once for each:
#   pure    Eigen and the standard library
#   wire    the same, gRPC, and the generated messages
# tests/CMakeLists.txt adds kinds with GoogleTest. The compiler reads the precompiled header before
# each file, so that a missing #include would not be seen: the target header_check compiles
# every header of ours without them.
#
# palpate_precompiled_kind(KIND HEADER LIBRARY...): HEADER is written from the root.
function(palpate_precompiled_kind kind header)
  set(empty ${CMAKE_BINARY_DIR}/precompiled/${kind}.cpp)
  file(CONFIGURE OUTPUT ${empty} CONTENT "")
  add_library(palpate_precompiled_${kind} OBJECT ${empty})
  target_link_libraries(palpate_precompiled_${kind} PRIVATE ${ARGN})
  target_precompile_headers(palpate_precompiled_${kind} PRIVATE <${header}>)
endfunction()

# palpate_precompiled(KIND TARGET...)
# After a precompiled header gcc 12 forgets that the standard library is the system's, and shows
# what it falsely warns of in std::string. The header check and clang's builds go without.
function(palpate_precompiled kind)
  foreach(target IN LISTS ARGN)
    target_precompile_headers(${target} REUSE_FROM palpate_precompiled_${kind})
    target_compile_options(${target} PRIVATE
      $<$<CXX_COMPILER_ID:GNU>:-Wno-array-bounds;-Wno-stringop-overflow>)
  endforeach()
endfunction()
