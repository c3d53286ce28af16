find_package(Python3 REQUIRED COMPONENTS Interpreter)
add_test(NAME unit.include_layers
  COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/include_layers_test.py)
set_tests_properties(unit.include_layers PROPERTIES LABELS unit)
