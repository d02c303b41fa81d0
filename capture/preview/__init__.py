"""``ps4rig rig preview``: light after light on the rig, and a page that shows it."""
