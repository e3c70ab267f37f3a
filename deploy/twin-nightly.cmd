@rem Every night on Windows:
@rem   schtasks /Create /TN twin-nightly /SC DAILY /ST 03:15 /TR C:\twin\twin-nightly.cmd
@echo off
set TWIN_STORE=C:\twin\twin.db
set TWIN_CONTACT=you@example.no
(C:\twin\venv\Scripts\twin.exe sync-nvdb && C:\twin\venv\Scripts\twin.exe match) >> C:\twin\nightly.log 2>&1
