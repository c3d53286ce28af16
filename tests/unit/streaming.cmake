palpate_unit_test(volume_feed_test volume_feed_test.cpp
  CORE palpate::streaming palpate::volume_mirror)
palpate_unit_test(volume_streams_test volume_streams_test.cpp
  CORE palpate::streaming palpate::volume_mirror)
palpate_unit_test(volume_mirror_test volume_mirror_test.cpp CORE palpate::volume_mirror)
palpate_unit_test(volume_message_test volume_message_test.cpp palpate::wire)
