find_package(fmt REQUIRED)
find_package(nlohmann_json REQUIRED)
palpate_unit_test(lab_cells_test lab_cells_test.cpp palpate::lab nlohmann_json::nlohmann_json fmt::fmt)
target_compile_definitions(lab_cells_test PRIVATE
  PALPATE_CELLS_DIR="${CMAKE_SOURCE_DIR}/tests/data/cells")
