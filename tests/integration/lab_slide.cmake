# PALPATE_DATA_DIR is import.cmake's.
find_package(nlohmann_json REQUIRED)
palpate_test(offline lab_slide_test lab_slide_test.cpp palpate::lab)
add_dependencies(lab_slide_test palpate-import)
target_compile_definitions(lab_slide_test PRIVATE
  PALPATE_IMPORT="$<TARGET_FILE:palpate-import>"
  PALPATE_DATA_DIR="${PALPATE_DATA_DIR}")

palpate_test(offline lab_replay_program_test lab_replay_program_test.cpp
  palpate::lab nlohmann_json::nlohmann_json)
add_dependencies(lab_replay_program_test palpate-lab palpate-import)
target_compile_definitions(lab_replay_program_test PRIVATE
  PALPATE_LAB="$<TARGET_FILE:palpate-lab>"
  PALPATE_DATA_DIR="${PALPATE_DATA_DIR}")
