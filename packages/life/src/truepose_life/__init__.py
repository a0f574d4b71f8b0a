"""Life-cycle study: which law stays accurate after what a year does to a calibrated robot."""
