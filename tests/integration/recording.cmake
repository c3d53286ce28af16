find_package(nlohmann_json REQUIRED)
palpate_integration_test(daemon_recording_test daemon_recording_test.cpp palpate::wire
  palpate::proto nlohmann_json::nlohmann_json)
add_dependencies(daemon_recording_test palpated palpate palpate-import palpate-lab)
target_compile_definitions(daemon_recording_test PRIVATE
  PALPATED="$<TARGET_FILE:palpated>"
  PALPATE="$<TARGET_FILE:palpate>"
  PALPATE_LAB="$<TARGET_FILE:palpate-lab>")
