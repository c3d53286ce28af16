palpate_unit_test(decomposition_test decomposition_test.cpp CORE palpate::isosurface)
palpate_unit_test(isosurface_test isosurface_test.cpp CORE palpate::isosurface)
target_compile_definitions(isosurface_test PRIVATE
  PALPATE_CELLS_DIR="${CMAKE_SOURCE_DIR}/tests/data/cells")
