add_executable(volume_export_child volume_export_child.cpp)
target_link_libraries(volume_export_child PRIVATE palpate::volume)
set_target_properties(volume_export_child PROPERTIES
  RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
palpate_integration_test(volume_export_test volume_export_test.cpp palpate::volume)
add_dependencies(volume_export_test volume_export_child palpate-import)
target_compile_definitions(volume_export_test PRIVATE
  PALPATE_IMPORT="$<TARGET_FILE:palpate-import>"
  VOLUME_EXPORT_CHILD="$<TARGET_FILE:volume_export_child>")

find_package(nlohmann_json REQUIRED)
foreach(test daemon_edit_test daemon_edit_client_test)
  palpate_integration_test(${test} ${test}.cpp palpate::wire palpate::proto
    nlohmann_json::nlohmann_json)
  add_dependencies(${test} palpated palpate palpate-import)
  target_compile_definitions(${test} PRIVATE
    PALPATED="$<TARGET_FILE:palpated>"
    PALPATE="$<TARGET_FILE:palpate>")
endforeach()
