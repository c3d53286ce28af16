palpate_unit_test(realtime_test realtime_test.cpp SANITIZED palpate::realtime)
