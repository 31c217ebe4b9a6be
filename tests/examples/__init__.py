"""The example robots a second time: closed forms and virtual campaigns that share no code with the library.

Every number of a robot is written down again here, and none of these modules imports ``pouring_robot``; only the tests
bring both sides together.
"""
