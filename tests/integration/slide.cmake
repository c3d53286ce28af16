# PALPATE_DATA_DIR is import.cmake's.
palpate_test(offline slide_test slide_test.cpp palpate::session)
add_dependencies(slide_test palpate-import)
target_compile_definitions(slide_test PRIVATE
  PALPATE_IMPORT="$<TARGET_FILE:palpate-import>"
  PALPATE_DATA_DIR="${PALPATE_DATA_DIR}")
