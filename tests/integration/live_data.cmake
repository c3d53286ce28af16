# PALPATE_DATA_DIR is import.cmake's.
palpate_integration_test(live_data_test live_data_test.cpp ALONE palpate::wire palpate::proto
  palpate::realtime)
add_dependencies(live_data_test palpated palpate-import)
target_compile_definitions(live_data_test PRIVATE
  PALPATED="$<TARGET_FILE:palpated>"
  PALPATE_DATA_DIR="${PALPATE_DATA_DIR}")
