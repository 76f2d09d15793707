"""Any robot with closed loops as files of other formats."""
