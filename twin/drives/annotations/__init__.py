"""What people annotated: files of annotation tools → where each object was seen."""
