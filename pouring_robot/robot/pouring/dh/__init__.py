"""The paper's DH table: 32 parameters a chain, read off the URDF, and the joint placements they stand for."""
