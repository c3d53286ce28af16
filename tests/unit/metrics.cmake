palpate_unit_test(servo_metrics_test servo_metrics_test.cpp palpate::metrics)
