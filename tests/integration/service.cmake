palpate_integration_test(daemon_service_test daemon_service_test.cpp palpate::wire palpate::proto)
add_dependencies(daemon_service_test palpated palpate palpate-import)
target_compile_definitions(daemon_service_test PRIVATE
  PALPATED="$<TARGET_FILE:palpated>"
  PALPATE="$<TARGET_FILE:palpate>")
