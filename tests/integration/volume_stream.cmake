palpate_integration_test(volume_stream_test volume_stream_test.cpp palpate::rpc palpate::sdk)
add_dependencies(volume_stream_test palpated palpate)
target_compile_definitions(volume_stream_test PRIVATE
  PALPATED="$<TARGET_FILE:palpated>"
  PALPATE="$<TARGET_FILE:palpate>")
