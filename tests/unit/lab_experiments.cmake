palpate_unit_test(lab_experiments_test lab_experiments_test.cpp palpate::lab)
target_compile_definitions(lab_experiments_test PRIVATE
  PALPATE_CELLS_DIR="${CMAKE_SOURCE_DIR}/tests/data/cells")
