find_package(nlohmann_json REQUIRED)
foreach(test daemon_stream_test daemon_control_test daemon_lifecycle_test daemon_settings_test
        daemon_load_test daemon_upload_test daemon_series_test daemon_memory_test
        daemon_registration_test daemon_device_test)
  set(beside "")
  if(test STREQUAL "daemon_stream_test")
    set(beside ALONE)
  endif()
  palpate_integration_test(${test} ${test}.cpp ${beside} palpate::wire palpate::proto
    nlohmann_json::nlohmann_json)
  add_dependencies(${test} palpated palpate palpate-import)
  target_compile_definitions(${test} PRIVATE
    PALPATED="$<TARGET_FILE:palpated>"
    PALPATE="$<TARGET_FILE:palpate>"
    PALPATE_DATA_DIR="${PALPATE_DATA_DIR}")
endforeach()
# Its times are judged where the sanitizers do not make them; the rest everywhere.
set(beside ALONE)
if(PALPATE_SANITIZE)
  set(beside "")
endif()
palpate_integration_test(daemon_crowd_test daemon_crowd_test.cpp ${beside}
  palpate::wire palpate::proto palpate::realtime)
target_sources(daemon_crowd_test PRIVATE ${PROJECT_SOURCE_DIR}/tests/load/servo_figures.cpp
  ${PROJECT_SOURCE_DIR}/tests/load/subscriber.cpp)
target_compile_definitions(daemon_crowd_test PRIVATE PALPATED="$<TARGET_FILE:palpated>")
add_dependencies(daemon_crowd_test palpated)
find_package(ZLIB REQUIRED)
target_link_libraries(daemon_upload_test PRIVATE palpate::geometry ZLIB::ZLIB)
target_link_libraries(daemon_series_test PRIVATE palpate::geometry)
target_link_libraries(daemon_stream_test PRIVATE palpate::realtime)
