"""Calls that render and watch, and the frames they give."""
