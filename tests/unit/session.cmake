palpate_unit_test(session_test session_test.cpp SANITIZED palpate::session)
palpate_unit_test(pose_stream_test pose_stream_test.cpp palpate::rpc)
palpate_unit_test(render_service_test render_service_test.cpp palpate::rpc)
find_package(fmt REQUIRED)
palpate_unit_test(config_test config_test.cpp palpate::app fmt::fmt)
target_compile_definitions(config_test PRIVATE
  PALPATED_TOML="${CMAKE_SOURCE_DIR}/deploy/config/palpated.toml")
palpate_unit_test(snapshot_test snapshot_test.cpp palpate::volume)
