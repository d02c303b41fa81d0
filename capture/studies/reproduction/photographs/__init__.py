"""The solvers on real photographs, judged by the photographs of lights that they did not use.

photograph_set -> a folder of photographs with lights.json; picks of four lights near a ring
scores         -> one pick solved by each method, and the errors
recognition    -> patches of the objects, matched with and without their object taught
exhibits       -> tables and pictures
run            -> the page and its files
"""
