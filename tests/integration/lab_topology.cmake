# PALPATE_DATA_DIR is import.cmake's; the published cells lie beside it.
palpate_test(offline lab_topology_test lab_topology_test.cpp palpate::lab)
add_dependencies(lab_topology_test palpate-import)
target_compile_definitions(lab_topology_test PRIVATE
  PALPATE_IMPORT="$<TARGET_FILE:palpate-import>"
  PALPATE_DATA_DIR="${PALPATE_DATA_DIR}"
  PALPATE_SHARED_CELLS_DIR="${PALPATE_DATA_DIR}/../cells")
