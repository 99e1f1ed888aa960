"""Bags in rosbag2 format: writer, reader, recovery of damaged files, completeness."""
