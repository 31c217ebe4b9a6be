"""The example robots a second time: closed forms and virtual campaigns that share no code with the library.

Every number of a robot is repeated here, and none of these modules imports ``pouring_robot``; only the tests combine
both sides.
"""
