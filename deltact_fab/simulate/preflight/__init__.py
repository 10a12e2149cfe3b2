"""What a protocol will ask of stage and force sensor, before anything moves."""
