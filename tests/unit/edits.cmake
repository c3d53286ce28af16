palpate_unit_test(brick_directory_test brick_directory_test.cpp CORE palpate::volume)
palpate_unit_test(edit_test edit_test.cpp CORE palpate::volume)
palpate_unit_test(edit_refusal_test edit_refusal_test.cpp CORE palpate::volume)
palpate_unit_test(volume_editor_test volume_editor_test.cpp CORE palpate::session)
