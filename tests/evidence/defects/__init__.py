"""How many simulated defects the defect map finds, beside detectors without relief.

plan        -> textures, defects, numbers of parts
parts       -> good and defective parts, captured and solved
comparators -> detectors of one photograph, and of the albedo alone
learned     -> features of a network, where its weights are installed
detectors   -> these and the defect map, learned from the same parts
scores      -> areas under ROC and PRO curves
measure     -> scores of all parts of one texture by all detectors
exhibits    -> tables and pictures
run         -> the page and its files
"""
