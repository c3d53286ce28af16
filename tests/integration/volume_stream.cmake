palpate_integration_test(volume_stream_test volume_stream_test.cpp palpate::rpc palpate::sdk)
palpate_integration_test(download_test download_test.cpp palpate::rpc)
foreach(test volume_stream_test download_test)
  add_dependencies(${test} palpated palpate palpate-import)
  target_compile_definitions(${test} PRIVATE
    PALPATED="$<TARGET_FILE:palpated>"
    PALPATE="$<TARGET_FILE:palpate>"
    PALPATE_IMPORT="$<TARGET_FILE:palpate-import>")
endforeach()
