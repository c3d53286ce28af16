palpate_unit_test(volume_feed_test volume_feed_test.cpp
  SANITIZED palpate::streaming palpate::volume_mirror)
