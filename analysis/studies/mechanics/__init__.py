"""The power-consistent robot against two recorded arms: what was fitted to a first half, judged
on the second.
"""
