"""Runs training sessions: a person drives the robot in real time, one tick a millisecond."""
