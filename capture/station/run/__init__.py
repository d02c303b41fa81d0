"""The run of a station: trigger, exposure, verdict, record, announcement."""
