palpate_unit_test(session_test session_test.cpp SANITIZED palpate::session)
palpate_unit_test(pose_stream_test pose_stream_test.cpp palpate::rpc)
palpate_unit_test(render_service_test render_service_test.cpp palpate::rpc)
palpate_unit_test(config_test config_test.cpp palpate::app)
