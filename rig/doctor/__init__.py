"""Everything that is looked at before a rig is trusted, and what to do about what is found.

`diagnosis` goes through it all; each other file looks at one thing. Nothing else needs any of it.
"""
