"""Links to robots and consoles over a network: ITP, joint state, `ravenjax robot`, and remote
robots.
"""
