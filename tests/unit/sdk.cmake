palpate_unit_test(backoff_test backoff_test.cpp CORE)
palpate_unit_test(volume_copy_test volume_copy_test.cpp CORE palpate::volume_copy)
palpate_unit_test(sdk_messages_test sdk_messages_test.cpp palpate::client palpate::wire)
