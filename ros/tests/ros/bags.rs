//! Recordings: what rosbags reads, what is left after a kill, and playing them again.
